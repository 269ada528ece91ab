//! Queries of a solid in world space: whether it contains a point, the nearest exit, and where a line is free of it.

use std::ops::Range;

use glam::DVec3;

use crate::kernel::{
    exact::{rigid_shape::ShapeGeometry, triangle_pair::PairProximity},
    mesh::{
        side::{closest_feature, face_normal},
        topology::SurfaceTopology,
    },
    pose::Pose,
};

/// Largest number of steps along a line through a shape.
const MOST_STEPS: usize = 256;

/// Points closer to the boundary of a shape than this share of the requested room count as on it.
const ON_BOUNDARY: f64 = 1.0e-3;

pub(super) enum Solid<'a> {
    Shape(PlacedShape<'a>),
    Closed(PlacedMesh<'a>),
    /// Triangles without an inside.
    Open(PlacedMesh<'a>),
}

/// A rigid shape in world space.
pub(super) struct PlacedShape<'a> {
    geometry: &'a ShapeGeometry,
    pose: Pose,
    own: Pose,
}

/// The triangles of a surface in world space.
pub(super) struct PlacedMesh<'a> {
    topology: &'a SurfaceTopology,
    points: Vec<DVec3>,
    low: DVec3,
    high: DVec3,
}

/// A point of the boundary, with the direction to leave there.
#[derive(Clone, Copy, Debug)]
pub(super) struct Exit {
    pub(super) at: DVec3,
    /// Unit vector out of the solid.
    pub(super) outward: DVec3,
}

impl<'a> Solid<'a> {
    pub(super) fn shape(geometry: &'a ShapeGeometry, pose: Pose) -> Self {
        Self::Shape(PlacedShape { geometry, pose, own: pose.inverse() })
    }

    pub(super) fn surface(topology: &'a SurfaceTopology, points: Vec<DVec3>, has_inside: bool) -> Self {
        let empty = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let (low, high) = points.iter().fold(empty, |(low, high), &point| (low.min(point), high.max(point)));
        let mesh = PlacedMesh { topology, points, low, high };
        if has_inside { Self::Closed(mesh) } else { Self::Open(mesh) }
    }

    /// Whether a point is inside. For a shape tested by formula, whether it is deeper than `shallow`.
    pub(super) fn contains(&self, point: DVec3, shallow: f64) -> bool {
        match self {
            Self::Shape(shape) => shape.signed_distance(point) < -shallow,
            Self::Closed(mesh) => mesh.contains(point),
            Self::Open(_) => false,
        }
    }

    /// Approximate cost of a query of one point, in triangles.
    pub(super) fn cost(&self) -> usize {
        match self {
            Self::Shape(_) => 1,
            Self::Closed(mesh) | Self::Open(mesh) => mesh.topology.triangles().len(),
        }
    }

    /// Whether a point is in the bounding box of a surface. Always true for a shape.
    pub(super) fn may_contain(&self, point: DVec3) -> bool {
        match self {
            Self::Shape(_) => true,
            Self::Closed(mesh) | Self::Open(mesh) => point.cmpge(mesh.low).all() && point.cmple(mesh.high).all(),
        }
    }

    /// The nearest point of the boundary.
    pub(super) fn nearest_exit(&self, point: DVec3) -> Option<Exit> {
        match self {
            Self::Shape(shape) => shape.nearest_exit(point),
            Self::Closed(mesh) | Self::Open(mesh) => mesh.nearest_exit(point),
        }
    }

    /// The triangle of the boundary that is nearest to a point, 0 for a shape.
    pub(super) fn nearest_triangle(&self, point: DVec3) -> Option<u32> {
        match self {
            Self::Shape(_) => Some(0),
            Self::Closed(mesh) | Self::Open(mesh) => mesh.nearest(point).map(|(triangle, _)| triangle),
        }
    }

    /// Distance to travel from a point along a unit direction, at least `from`, until the next `room` is free of the
    /// solid.
    pub(super) fn free_from(&self, point: DVec3, direction: DVec3, from: f64, room: f64) -> Option<f64> {
        match self {
            Self::Shape(shape) => shape.free_from(point, direction, from, room),
            Self::Closed(mesh) => Some(mesh.free_from(point, direction, from, room)),
            Self::Open(mesh) => {
                let mut is_crossed = false;
                mesh.cross(point, direction, |at, _| is_crossed |= (0.0..from + room).contains(&at));
                (!is_crossed).then_some(from)
            }
        }
    }
}

impl PlacedShape<'_> {
    fn signed_distance(&self, point: DVec3) -> f64 {
        self.geometry.signed_distance(self.own.transform_point(point)) * self.pose.scale()
    }

    fn nearest_exit(&self, point: DVec3) -> Option<Exit> {
        let own = self.own.transform_point(point);
        let (mut scratch, mut found) = (PairProximity::default(), Vec::new());
        self.geometry.examine(&[own; 3], 0.0, &mut scratch, &mut found);
        let nearest = found.iter().min_by(|one, other| one.distance.total_cmp(&other.distance))?;
        let outward = self.pose.transform_direction(nearest.normal).try_normalize()?;
        Some(Exit { at: self.pose.transform_point(nearest.shape_point), outward })
    }

    /// Sphere tracing: no step is longer than the distance to the boundary.
    fn free_from(&self, point: DVec3, direction: DVec3, from: f64, room: f64) -> Option<f64> {
        let least = room * ON_BOUNDARY;
        let (mut at, mut free) = (from, None);
        for _ in 0..MOST_STEPS {
            let distance = self.signed_distance(point + direction * at);
            if distance < -least {
                free = None;
            } else if at - *free.get_or_insert(at) >= room {
                return free;
            }
            at += distance.abs().max(least);
        }
        None
    }
}

impl PlacedMesh<'_> {
    fn corners(&self, triangle: &[u32; 3]) -> [DVec3; 3] {
        triangle.map(|vertex| self.points[vertex as usize])
    }

    /// Whether a ray along x leaves the surface more often than it enters it.
    fn contains(&self, point: DVec3) -> bool {
        let mut winding = 0;
        self.cross(point, DVec3::X, |at, leaves| {
            if at > 0.0 {
                winding += if leaves { 1 } else { -1 };
            }
        });
        winding > 0
    }

    /// Visits the intersections of a line with the triangles: the signed distance along the unit direction, and whether
    /// the line leaves the surface there.
    fn cross(&self, point: DVec3, direction: DVec3, mut visit: impl FnMut(f64, bool)) {
        let (u, v) = direction.any_orthonormal_pair();
        let (center, extent) = ((self.low + self.high) / 2.0 - point, (self.high - self.low) / 2.0);
        if [u, v].into_iter().any(|axis| axis.dot(center).abs() > axis.abs().dot(extent)) {
            return;
        }
        for triangle in self.topology.triangles() {
            let corners = self.corners(triangle).map(|corner| corner - point);
            let across = corners.map(|corner| u.dot(corner));
            // Half-open test: a line through an edge or a vertex is counted once.
            let above = across.map(|across| across > 0.0);
            if above[0] == above[1] && above[1] == above[2] {
                continue;
            }
            let mut sides: [Option<f64>; 2] = [None; 2];
            for side in 0..3 {
                let (from, to) = (side, (side + 1) % 3);
                if above[from] != above[to] {
                    let along = across[from] / (across[from] - across[to]);
                    let [start, end] = [corners[from], corners[to]].map(|corner| v.dot(corner));
                    sides[usize::from(sides[0].is_some())] = Some(start + (end - start) * along);
                }
            }
            let [Some(first), Some(second)] = sides else { continue };
            if (first > 0.0) == (second > 0.0) {
                continue;
            }
            let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
            let rise = normal.dot(direction);
            if rise != 0.0 {
                visit(normal.dot(corners[0]) / rise, rise > 0.0);
            }
        }
    }

    fn free_from(&self, point: DVec3, direction: DVec3, from: f64, room: f64) -> f64 {
        let mut places = Vec::new();
        self.cross(point, direction, |at, leaves| places.push((at, leaves)));
        places.sort_unstable_by(|one, other| one.0.total_cmp(&other.0));
        // Scan backward from the far end, where nothing is inside.
        let mut inside: Vec<Range<f64>> = Vec::new();
        let (mut winding, mut end) = (0, 0.0);
        for &(at, leaves) in places.iter().rev() {
            let before = winding;
            winding += if leaves { 1 } else { -1 };
            match (before > 0, winding > 0) {
                (false, true) => end = at,
                (true, false) => inside.push(at..end),
                _ => {}
            }
        }
        if winding > 0 {
            inside.push(f64::NEG_INFINITY..end);
        }
        let mut free = from;
        for range in inside.iter().rev() {
            if range.start < free + room && range.end > free {
                free = range.end;
            }
        }
        free
    }

    fn nearest_exit(&self, point: DVec3) -> Option<Exit> {
        let (triangle, at) = self.nearest(point)?;
        let corners = self.corners(&self.topology.triangles()[triangle as usize]);
        let outward = (at - point).try_normalize().or_else(|| face_normal(&corners).try_normalize())?;
        Some(Exit { at, outward })
    }

    /// The nearest triangle, the lowest of equally near ones, and its nearest point.
    fn nearest(&self, point: DVec3) -> Option<(u32, DVec3)> {
        let mut nearest: Option<(f64, u32, DVec3)> = None;
        for (number, triangle) in (0..).zip(self.topology.triangles()) {
            let corners = self.corners(triangle);
            let low = corners[0].min(corners[1]).min(corners[2]);
            let high = corners[0].max(corners[1]).max(corners[2]);
            let best = nearest.map_or(f64::INFINITY, |(squared, ..)| squared);
            if point.clamp(low, high).distance_squared(point) >= best {
                continue;
            }
            let (_, at) = closest_feature(&corners, point);
            let squared = at.distance_squared(point);
            if squared < best {
                nearest = Some((squared, number, at));
            }
        }
        nearest.map(|(_, triangle, at)| (triangle, at))
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use parry3d::shape::SharedShape;

    use super::*;

    /// A cube of side length 2, centered at the origin.
    fn cube() -> (SurfaceTopology, Vec<DVec3>) {
        let corners: Vec<Vec3> = (0..8)
            .map(|bits| Vec3::new((bits & 1) as f32, (bits >> 1 & 1) as f32, (bits >> 2) as f32) * 2.0 - 1.0)
            .collect();
        let triangles = [
            [0, 2, 3],
            [0, 3, 1],
            [4, 5, 7],
            [4, 7, 6],
            [0, 1, 5],
            [0, 5, 4],
            [2, 6, 7],
            [2, 7, 3],
            [0, 4, 6],
            [0, 6, 2],
            [1, 3, 7],
            [1, 7, 5],
        ];
        let points = corners.iter().map(|corner| corner.as_dvec3()).collect();
        (SurfaceTopology::new(&corners, &triangles).unwrap(), points)
    }

    #[test]
    fn points_of_a_grid_are_inside_a_cube_where_their_coordinates_say_so() {
        let (topology, points) = cube();
        let closed = Solid::surface(&topology, points, true);
        let mut inside = 0;
        for place in 0..9 * 9 * 9 {
            let [x, y, z] = [place % 9, place / 9 % 9, place / 81].map(|step| f64::from(step) * 0.31 - 1.24);
            let point = DVec3::new(x, y, z);
            let expected = point.abs().max_element() < 1.0;
            assert_eq!(closed.contains(point, 0.0), expected, "{point}");
            if expected {
                inside += 1;
                let Exit { at: exit, outward } = closed.nearest_exit(point).unwrap();
                let depth = 1.0 - point.abs().max_element();
                assert!((exit.distance(point) - depth).abs() < 1e-12, "{point}: {exit} {depth}");
                assert!((point + outward * depth).distance(exit) < 1e-12, "{point}: {outward}");
            }
        }
        assert!(inside > 100);
    }

    #[test]
    fn a_ray_along_edges_and_through_vertices_counts_them_once() {
        let (topology, points) = cube();
        let closed = Solid::surface(&topology, points, true);
        // Diagonals of the faces, where two triangles share an edge.
        for at in [-0.5, 0.0, 0.25] {
            assert!(closed.contains(DVec3::new(0.0, at, at), 0.0));
            assert!(closed.contains(DVec3::new(0.0, at, -at), 0.0));
            assert!(!closed.contains(DVec3::new(-3.0, at, at), 0.0));
            assert!(!closed.contains(DVec3::new(3.0, at, at), 0.0));
        }
    }

    #[test]
    fn a_line_is_free_of_a_cube_where_it_leaves_it_and_in_gaps_that_have_room() {
        let (topology, points) = cube();
        let shape = SharedShape::cuboid(1.0, 1.0, 1.0);
        let geometry = ShapeGeometry::new(&shape).unwrap();
        let solids = [Solid::surface(&topology, points, true), Solid::shape(&geometry, Pose::IDENTITY)];
        let from = DVec3::new(0.1, 0.2, -0.3);
        for solid in &solids {
            let free = |from: DVec3, direction: DVec3, room: f64| solid.free_from(from, direction, 0.0, room).unwrap();
            for direction in [DVec3::X, DVec3::NEG_Y, DVec3::Z, DVec3::new(1.0, 1.0, 0.0).normalize()] {
                let sides = (DVec3::ONE - from * direction.signum()) / direction.abs();
                assert!((free(from, direction, 0.1) - sides.min_element()).abs() < 1e-3, "{direction}");
            }
            // Half a unit in front of the cube: that is enough for less room. For more, the line is free only behind
            // the cube.
            let before = DVec3::new(-1.5, 0.2, -0.3);
            assert_eq!(free(before, DVec3::X, 0.4), 0.0);
            assert!((free(before, DVec3::X, 0.6) - 2.5).abs() < 1e-3);
        }
    }

    #[test]
    fn no_line_into_a_half_space_is_free() {
        let shape = SharedShape::halfspace(Vec3::Y);
        let geometry = ShapeGeometry::new(&shape).unwrap();
        let solid = Solid::shape(&geometry, Pose::IDENTITY);
        assert_eq!(solid.free_from(DVec3::NEG_Y, DVec3::NEG_Y, 0.0, 1.0), None);
        assert!((solid.free_from(DVec3::NEG_Y, DVec3::Y, 0.0, 1.0).unwrap() - 1.0).abs() < 1e-3);
    }
}
