//! Thickness that differs from vertex to vertex.
//!
//! In between, it is interpolated linearly. So a triangle with its thickness is the convex hull of the balls at its corners,
//! and two triangles touch if these hulls meet: if two of their points are no farther apart than the sum of the thicknesses
//! there. Everything before the exact test takes the largest thickness of the surface. A *lack* is by how much the thickness
//! at a point is less than that, so points touch if their distance and both lacks together are at most the contact distance.
//! Where the thickness is the same everywhere, nothing lacks.

/// What lacks at a point of a triangle, given what lacks at its corners, and the point's weights.
#[inline]
pub(in crate::kernel) fn lack_at(lacks: &[f64; 3], weights: &[f64; 3]) -> f64 {
    lacks[0] * weights[0] + lacks[1] * weights[1] + lacks[2] * weights[2]
}

/// The thickness at each vertex of a surface, and how it compares with the largest.
#[derive(Clone, Copy, Debug)]
pub struct VaryingThickness<'a> {
    /// One for each vertex, in the unit of the surface's own frame, at most `largest`.
    pub at_vertices: &'a [f32],
    /// The largest of them.
    pub largest: f32,
    /// World length of one unit of the surface's own frame.
    pub scale: f64,
}

impl VaryingThickness<'_> {
    /// What lacks at some vertices, in world units, 0 or more.
    #[inline]
    #[must_use]
    pub fn lacks(&self, vertices: [u32; 3]) -> [f64; 3] {
        vertices.map(|vertex| {
            (f64::from(self.largest) - f64::from(self.at_vertices[vertex as usize])).max(0.0) * self.scale
        })
    }

    /// What lacks at a point of a triangle, in world units, given its vertices and the weights of the first two.
    #[inline]
    #[must_use]
    pub fn lack_at(&self, vertices: [u32; 3], [first, second]: [f32; 2]) -> f64 {
        let [first, second] = [f64::from(first), f64::from(second)];
        lack_at(&self.lacks(vertices), &[first, second, 1.0 - first - second])
    }

    /// The thickness at some vertices, in world units.
    #[inline]
    #[must_use]
    pub fn at(&self, vertices: [u32; 3]) -> [f64; 3] {
        vertices.map(|vertex| f64::from(self.at_vertices[vertex as usize]) * self.scale)
    }
}
