//! The rest shape of a body: what its constraints restore.

use std::collections::BTreeSet;

use glam::{DVec3, Vec3};

use crate::kernel::{
    mesh::{
        ids::{EdgeId, TetrahedronId},
        topology::SurfaceTopology,
    },
    tetrahedra::topology::{TetrahedraError, TetrahedralTopology},
    xpbd::{HingeRests, SailRests, Slabs, SpringRests, TetrahedronRest, TetrahedronRests, VolumeRest, bend_at},
};

/// The rest shape of a body: lengths, bends, areas, and volume, in the surface's own frame.
#[derive(Clone, Debug, Default)]
pub(super) struct RestShape {
    pub(super) springs: SpringRests,
    pub(super) hinges: HingeRests,
    /// Only if the surface is closed and encloses a volume.
    pub(super) volume: Option<VolumeRest>,
    pub(super) sails: SailRests,
    /// The tetrahedra that resist, if it has an inside.
    pub(super) tetrahedra: TetrahedronRests,
    pub(super) inside: Option<Inside>,
    /// The vertices of each slab.
    pub(super) parts: Vec<Vec<u32>>,
    /// What it was made from.
    pub(super) positions: Vec<Vec3>,
}

/// How often volumes are evened out among neighbors.
const SPREADINGS: usize = 4;

/// The tetrahedra of a body.
#[derive(Clone, Debug)]
pub(super) struct Inside {
    /// All of them, in the order of the [`TetrahedralBody`](crate::TetrahedralBody).
    pub(super) tetrahedra: Vec<[u32; 4]>,
    /// Those that do not resist: inverted or nearly flat at rest. Ascending.
    pub(super) left_out: Vec<TetrahedronId>,
    /// The volume that each vertex stands for: a quarter of that of its tetrahedra, [spread](spread) among neighbors.
    pub(super) volumes: Vec<f64>,
    /// Of each tetrahedron, positive or negative by its winding.
    signed_volumes: Vec<f64>,
}

impl Inside {
    /// The volume of every tetrahedron at some positions relative to that at rest.
    pub(super) fn relative_volumes<'a>(&'a self, positions: &'a [Vec3]) -> impl Iterator<Item = f32> + 'a {
        let at = |vertex: u32| positions[vertex as usize].as_dvec3();
        self.tetrahedra
            .iter()
            .zip(&self.signed_volumes)
            .map(move |(corners, rest)| (volume(corners.map(at)) / rest) as f32)
    }
}

/// The signed volume of a tetrahedron.
fn volume([origin, a, b, c]: [DVec3; 4]) -> f64 {
    (a - origin).dot((b - origin).cross(c - origin)) / 6.0
}

impl RestShape {
    /// The rest shape of a surface. With tetrahedra, every edge of theirs is a spring as well.
    pub(super) fn new(
        topology: &SurfaceTopology,
        positions: &[Vec3],
        tetrahedra: Option<&[[u32; 4]]>,
    ) -> Result<Self, TetrahedraError> {
        let points: Vec<DVec3> = positions.iter().map(|position| position.as_dvec3()).collect();
        let mut springs = Vec::with_capacity(topology.edges().len());
        let mut hinges = Vec::new();
        for (edge, &ends) in topology.edges().iter().enumerate() {
            if ends[0] == ends[1] {
                continue;
            }
            let length = points[ends[0] as usize].distance(points[ends[1] as usize]);
            springs.push((ends, length));
            if let &[first, second] = topology.triangles_of_edge(EdgeId(edge as u32)) {
                hinges.extend(hinge(topology, edge as u32, first, second, &points));
            }
        }
        let mut slabs = Slabs::default();
        slabs.split(&points);
        let (mut rests, mut inside) = (Vec::new(), None);
        if let Some(tetrahedra) = tetrahedra {
            let mut found = find_inside(topology, positions, &points, tetrahedra, &mut rests)?;
            let at = |vertex: u32| points[vertex as usize];
            springs.extend(
                inner_edges(topology, &rests).into_iter().map(|ends| (ends, at(ends[0]).distance(at(ends[1])))),
            );
            spread(&mut found.volumes, &springs);
            inside = Some(found);
        }
        let volume = topology.is_closed().then(|| VolumeRest::new(&points, topology.welded_triangles()));
        let sails = topology.welded_triangles().iter().map(|corners| (*corners, area(corners, &points) as f32));
        Ok(Self {
            sails: SailRests::new(points.len(), &slabs, sails),
            springs: SpringRests::new(points.len(), &slabs, springs.into_iter()),
            hinges: HingeRests::new(points.len(), &slabs, hinges.into_iter()),
            volume: volume.flatten(),
            tetrahedra: TetrahedronRests::new(points.len(), &slabs, rests.into_iter()),
            inside,
            parts: slabs.parts(),
            positions: positions.to_vec(),
        })
    }
}

/// Finds the tetrahedra that resist, between welded vertices, and those that do not.
fn find_inside(
    surface: &SurfaceTopology,
    positions: &[Vec3],
    points: &[DVec3],
    tetrahedra: &[[u32; 4]],
    rests: &mut Vec<([u32; 4], TetrahedronRest)>,
) -> Result<Inside, TetrahedraError> {
    let topology = TetrahedralTopology::new(positions, tetrahedra)?;
    let inverted = &topology.report().inverted;
    let mut volumes = vec![0.0; points.len()];
    let (mut left_out, mut signed_volumes) = (Vec::new(), Vec::new());
    for (number, corners) in (0..).map(TetrahedronId).zip(tetrahedra) {
        let corners = corners.map(|vertex| surface.weld()[vertex as usize]);
        let at = corners.map(|vertex| points[vertex as usize]);
        let (rest, signed) = (TetrahedronRest::new(&at), volume(at));
        signed_volumes.push(signed);
        for vertex in corners {
            volumes[vertex as usize] += 0.25 * signed.abs();
        }
        if rest.is_flat() || inverted.binary_search(&number).is_ok() {
            left_out.push(number);
        } else {
            rests.push((corners, rest));
        }
    }
    Ok(Inside { tetrahedra: tetrahedra.to_vec(), left_out, volumes, signed_volumes })
}

/// Evens out volumes along edges, and keeps their sum. A vertex on an edge or at a corner of a body may otherwise stand for
/// a twentieth of the volume of one inside. A load on such a vertex would have to pass through its small mass, which takes
/// the solver many substeps, and would squash the tetrahedra around it.
fn spread(volumes: &mut [f64], edges: &[([u32; 2], f64)]) {
    let mut degrees = vec![0_u32; volumes.len()];
    for vertex in edges.iter().flat_map(|(ends, _)| *ends) {
        degrees[vertex as usize] += 1;
    }
    for _ in 0..SPREADINGS {
        let before = volumes.to_vec();
        for &([a, b], _) in edges {
            let [a, b] = [a, b].map(|vertex| vertex as usize);
            // No vertex gives away more than it has.
            let passed = (before[a] - before[b]) / f64::from(1 + degrees[a].max(degrees[b]));
            volumes[a] -= passed;
            volumes[b] += passed;
        }
    }
}

/// The edges of tetrahedra that are not edges of the surface, sorted.
fn inner_edges(surface: &SurfaceTopology, rests: &[([u32; 4], TetrahedronRest)]) -> BTreeSet<[u32; 2]> {
    let sorted = |a: u32, b: u32| [a.min(b), a.max(b)];
    let sides = |[a, b, c, d]: [u32; 4]| [[a, b], [a, c], [a, d], [b, c], [b, d], [c, d]];
    let all = rests.iter().flat_map(|(corners, _)| sides(*corners)).map(|[a, b]| sorted(a, b));
    let mut edges: BTreeSet<[u32; 2]> = all.collect();
    for &[a, b] in surface.edges() {
        edges.remove(&sorted(a, b));
    }
    edges
}

pub(super) fn area(corners: &[u32; 3], points: &[DVec3]) -> f64 {
    let [a, b, c] = corners.map(|vertex| points[vertex as usize]);
    0.5 * (b - a).cross(c - a).length()
}

/// The corners of the hinge at an edge between two triangles, and its bend.
fn hinge(topology: &SurfaceTopology, edge: u32, first: u32, second: u32, points: &[DVec3]) -> Option<([u32; 4], f64)> {
    let corner = |triangle: u32| {
        let side = topology.triangle_edges()[triangle as usize].iter().position(|&own| own == edge)?;
        let corners = topology.welded_triangles()[triangle as usize];
        Some((corners[side], corners[(side + 1) % 3], corners[(side + 2) % 3]))
    };
    let (start, end, left) = corner(first)?;
    let (other_start, _, right) = corner(second)?;
    // If both triangles run the same way along the edge, one of them is wound the other way round: there is no dihedral
    // angle.
    let corners = [start, end, left, right];
    if other_start == start || left == right {
        return None;
    }
    Some((corners, bend_at(&corners.map(|vertex| points[vertex as usize]))))
}
