//! Brute force in f64.

use glam::DVec3;

/// Where a ray meets a triangle, by Cramer's rule (Möller and Trumbore 1997).
#[derive(Clone, Copy, Debug)]
pub struct TrueHit {
    pub triangle: usize,
    pub distance: f64,
    pub barycentric: [f64; 3],
    pub is_back_face: bool,
}

/// Solves for the point where the line of a ray meets the plane of a triangle. `None` if they are parallel.
pub fn on_plane(triangle: usize, corners: &[DVec3; 3], origin: DVec3, direction: DVec3) -> Option<TrueHit> {
    let [a, b, c] = *corners;
    let (first, second, from) = (b - a, c - a, origin - a);
    let across = direction.cross(second);
    let volume = first.dot(across);
    if volume == 0.0 {
        return None;
    }
    let turned = from.cross(first);
    let (v, w) = (from.dot(across) / volume, direction.dot(turned) / volume);
    let distance = second.dot(turned) / volume;
    Some(TrueHit { triangle, distance, barycentric: [1.0 - v - w, v, w], is_back_face: volume < 0.0 })
}

/// What is known for sure about a ray and a mesh.
pub struct TrueRay {
    /// All triangles that are hit, the nearest first. Those that are hit within `doubt` of their border may be missing.
    pub hits: Vec<TrueHit>,
    /// Hits so close to the border of a triangle or to an end of the ray, or so oblique, that rounding decides.
    pub doubtful: Vec<TrueHit>,
}

/// Tests all triangles. `doubt` is by how much weights may be wrong.
pub fn cast(triangles: &[[DVec3; 3]], origin: DVec3, direction: DVec3, range: f64, doubt: f64) -> TrueRay {
    let mut found = TrueRay { hits: Vec::new(), doubtful: Vec::new() };
    for (triangle, corners) in triangles.iter().enumerate() {
        let Some(hit) = on_plane(triangle, corners, origin, direction) else { continue };
        let margin = hit.barycentric.iter().fold(f64::INFINITY, |least, weight| least.min(*weight));
        let margin = margin.min(hit.distance).min(range - hit.distance);
        if margin > doubt {
            found.hits.push(hit);
        } else if margin >= -doubt {
            found.doubtful.push(hit);
        }
    }
    found.hits.sort_by(|one, other| one.distance.total_cmp(&other.distance));
    found
}

/// The point of a triangle that is closest to a point: of its plane if that is inside, otherwise of its edges.
pub fn closest_on(corners: &[DVec3; 3], point: DVec3) -> DVec3 {
    let [a, b, c] = *corners;
    let normal = (b - a).cross(c - a);
    if let Some(hit) = on_plane(0, corners, point, normal)
        && hit.barycentric.iter().all(|weight| *weight >= 0.0)
    {
        return point + normal * hit.distance;
    }
    let on_edge = |from: DVec3, to: DVec3| {
        let along = to - from;
        from + along * ((point - from).dot(along) / along.length_squared()).clamp(0.0, 1.0)
    };
    let candidates = [on_edge(a, b), on_edge(b, c), on_edge(c, a)];
    let nearest = candidates
        .into_iter()
        .min_by(|one, other| one.distance_squared(point).total_cmp(&other.distance_squared(point)));
    nearest.expect("a triangle has edges")
}
