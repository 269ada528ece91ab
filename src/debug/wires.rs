//! Wireframes of rigid shapes, in the shape's own frame.

use glam::Vec3;
use parry3d::shape::{SharedShape, TypedShape};

/// Number of corners of a circle.
const CORNERS: u32 = 24;

/// Number of cells along a side of the square grid that represents an infinite half-space.
const HALF_SPACE_CELLS: i32 = 20;

/// A polyline.
pub(super) type Wire = Vec<[f32; 3]>;

/// The wireframe of a shape. A half-space is a grid of lines below `center` that extends `reach` to each side.
pub(super) fn wires(shape: &SharedShape, center: Vec3, reach: f32) -> Vec<Wire> {
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
        TypedShape::HalfSpace(shape) => grid(shape.normal, center, reach),
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
                let seen_from_part = pose.inverse_transform_point(center);
                wires(part, seen_from_part, reach)
                    .into_iter()
                    .map(|wire| wire.into_iter().map(place).collect())
                    .collect::<Vec<Wire>>()
            };
            shape.shapes().iter().flat_map(moved).collect()
        }
        // The bounding box at least shows the place of the shape.
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

fn grid(normal: Vec3, center: Vec3, reach: f32) -> Vec<Wire> {
    let normal = normal.normalize_or(Vec3::Y);
    let (u, v) = normal.any_orthonormal_pair();
    let middle = center - normal * normal.dot(center);
    let place = |number: i32| reach * (2 * number - HALF_SPACE_CELLS) as f32 / HALF_SPACE_CELLS as f32;
    // Each line has as many segments as the grid has cells, because the viewer sets the thickness of a segment by the
    // distance of its ends.
    let line = |number: i32, across: Vec3, along: Vec3| -> Wire {
        let start = middle + across * place(number);
        (0..=HALF_SPACE_CELLS).map(|part| (start + along * place(part)).to_array()).collect()
    };
    (0..=HALF_SPACE_CELLS).flat_map(|number| [line(number, u, v), line(number, v, u)]).collect()
}
