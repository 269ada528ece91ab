//! Outlines of rigid shapes, as lines in the shape's own frame.

use glam::Vec3;
use parry3d::shape::{SharedShape, TypedShape};

/// Corners of a circle.
const CORNERS: u32 = 24;

/// Half the side of the square that stands for a half-space, which has no end, and its lines a side.
const HALF_SPACE_REACH: f32 = 10.0;
const HALF_SPACE_LINES: i32 = 20;

/// A line of points.
pub(super) type Wire = Vec<[f32; 3]>;

/// The outline of a shape. Of a half-space a grid of lines around its origin.
pub(super) fn wires(shape: &SharedShape) -> Vec<Wire> {
    match shape.as_typed_shape() {
        TypedShape::Ball(shape) => lines(shape.to_outline(CORNERS)),
        TypedShape::Cuboid(shape) => lines(shape.to_outline()),
        TypedShape::Capsule(shape) => lines(shape.to_outline(CORNERS)),
        TypedShape::Cone(shape) => lines(shape.to_outline(CORNERS)),
        TypedShape::Cylinder(shape) => lines(shape.to_outline(CORNERS)),
        TypedShape::RoundCuboid(shape) => lines(shape.to_outline(CORNERS)),
        TypedShape::RoundCone(shape) => lines(shape.to_outline(CORNERS, CORNERS)),
        TypedShape::RoundCylinder(shape) => lines(shape.to_outline(CORNERS, CORNERS)),
        TypedShape::RoundConvexPolyhedron(shape) => lines(shape.to_outline(CORNERS)),
        TypedShape::ConvexPolyhedron(shape) => {
            let points = shape.points();
            shape.edges().iter().map(|edge| edge.vertices.map(|end| points[end as usize].to_array()).to_vec()).collect()
        }
        TypedShape::HalfSpace(shape) => grid(shape.normal),
        TypedShape::Segment(shape) => vec![vec![shape.a.to_array(), shape.b.to_array()]],
        TypedShape::Triangle(shape) => vec![outline([shape.a, shape.b, shape.c])],
        TypedShape::RoundTriangle(shape) => {
            let triangle = &shape.inner_shape;
            vec![outline([triangle.a, triangle.b, triangle.c])]
        }
        TypedShape::TriMesh(shape) => {
            shape.triangles().map(|triangle| outline([triangle.a, triangle.b, triangle.c])).collect()
        }
        TypedShape::Polyline(shape) => {
            shape.segments().map(|segment| vec![segment.a.to_array(), segment.b.to_array()]).collect()
        }
        TypedShape::HeightField(shape) => {
            shape.triangles().map(|triangle| outline([triangle.a, triangle.b, triangle.c])).collect()
        }
        TypedShape::Compound(shape) => {
            let moved = |(pose, part): &(parry3d::math::Pose, SharedShape)| {
                let place = |point: [f32; 3]| (pose.rotation * Vec3::from_array(point) + pose.translation).to_array();
                wires(part).into_iter().map(|wire| wire.into_iter().map(place).collect()).collect::<Vec<Wire>>()
            };
            shape.shapes().iter().flat_map(moved).collect()
        }
        // A box says at least where it is.
        TypedShape::Voxels(_) | TypedShape::Custom(_) => {
            let bounds = shape.compute_local_aabb();
            let center = bounds.center();
            let cuboid = parry3d::shape::Cuboid::new(bounds.half_extents());
            let (points, edges) = cuboid.to_outline();
            lines((points.into_iter().map(|point| point + center).collect(), edges))
        }
    }
}

fn lines((points, edges): (Vec<Vec3>, Vec<[u32; 2]>)) -> Vec<Wire> {
    edges.into_iter().map(|edge| edge.map(|end| points[end as usize].to_array()).to_vec()).collect()
}

fn outline([a, b, c]: [Vec3; 3]) -> Wire {
    [a, b, c, a].map(|corner| corner.to_array()).to_vec()
}

fn grid(normal: Vec3) -> Vec<Wire> {
    let (u, v) = normal.normalize_or(Vec3::Y).any_orthonormal_pair();
    let line = |number: i32, across: Vec3, along: Vec3| {
        let middle = across * (HALF_SPACE_REACH * number as f32 / (HALF_SPACE_LINES / 2) as f32);
        let reach = along * HALF_SPACE_REACH;
        vec![(middle - reach).to_array(), (middle + reach).to_array()]
    };
    (-HALF_SPACE_LINES / 2..=HALF_SPACE_LINES / 2).flat_map(|number| [line(number, u, v), line(number, v, u)]).collect()
}
