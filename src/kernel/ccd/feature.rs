//! First impacts of a vertex with a face, and of two edges, whose vertices move in straight lines.
//!
//! Called by `triangle_pair`, or directly by a caller with its own list of features. Only the differences between the
//! points of the two features matter, so a common motion costs nothing, and distance from the origin costs no
//! precision.

use glam::DVec3;

use super::{
    advance::{Arrival, ImpactCause, MovingHull},
    parting::stay_apart,
};

/// When and how two moving features come within a separation of each other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FeatureImpact {
    /// 0 at the start of the step, 1 at its end. Never later than the first time at which the distance is at most the
    /// separation.
    pub time: f64,
    /// Whether the features start within the separation, reach it, or may reach it.
    pub cause: ImpactCause,
    /// Weights of the four points at that time. For each of the two features they sum to 1.
    pub weights: [f64; 4],
    /// Unit vector from the first feature to the second, perpendicular to a plane that separates them until that time.
    /// Zero if they touch at the start of the step.
    pub normal: DVec3,
    /// Steps that the search took.
    pub steps: u32,
}

/// First impact of a vertex, `[0]`, with a face, `[1]` to `[3]`, its boundary included.
///
/// `start` and `end` are the points at the start and at the end of the step, with finite coordinates (others never
/// meet). `separation` is the distance, 0 or more, that counts as an impact. `None` if the distance stays greater for
/// the whole step, both ends included. The order of the face's corners makes no difference to the time.
#[must_use]
pub fn vertex_face_impact(start: &[DVec3; 4], end: &[DVec3; 4], separation: f64) -> Option<FeatureImpact> {
    vertex_face_impact_within(start, end, separation, 0.0, 1.0)
}

/// First impact of two edges, `[0]` to `[1]` and `[2]` to `[3]`, their ends included.
///
/// Arguments and result are as for [`vertex_face_impact`]. The order of the edges and of their ends makes no difference
/// to the time.
#[must_use]
pub fn edge_edge_impact(start: &[DVec3; 4], end: &[DVec3; 4], separation: f64) -> Option<FeatureImpact> {
    edge_edge_impact_within(start, end, separation, 0.0, 1.0)
}

/// [`vertex_face_impact`] in a part of the step. The features must be clear before it.
pub(super) fn vertex_face_impact_within(
    start: &[DVec3; 4],
    end: &[DVec3; 4],
    separation: f64,
    from: f64,
    until: f64,
) -> Option<FeatureImpact> {
    let [(vertex_start, face_start), (vertex_end, face_end)] =
        [start, end].map(|[vertex, face @ ..]| (std::array::from_ref(vertex), face));
    if stay_apart([vertex_start, vertex_end], [face_start, face_end], separation, &mut DVec3::default()) {
        return None;
    }
    let mut order = [1, 2, 3];
    let later = |first: usize, second: usize| is_later(start, end, first, second);
    for [first, second] in [[0, 1], [1, 2], [0, 1]] {
        if later(order[first], order[second]) {
            order.swap(first, second);
        }
    }
    let differences = |points: &[DVec3; 4]| order.map(|corner| points[0] - points[corner]);
    let Arrival { time, cause, normal, place: [second, third], steps } =
        MovingHull::new(differences(start), differences(end))?.arrival(separation, from, until)?;
    let mut weights = [1.0; 4];
    for (corner, weight) in order.into_iter().zip([1.0 - second - third, second, third]) {
        weights[corner] = weight;
    }
    Some(FeatureImpact { time, cause, weights, normal: -normal, steps })
}

/// [`edge_edge_impact`] in a part of the step. The features must be clear before it.
pub(super) fn edge_edge_impact_within(
    start: &[DVec3; 4],
    end: &[DVec3; 4],
    separation: f64,
    from: f64,
    until: f64,
) -> Option<FeatureImpact> {
    let edges = |[a0, a1, b0, b1]: &[DVec3; 4]| [[*a0, *a1], [*b0, *b1]];
    let ([start_a, start_b], [end_a, end_b]) = (edges(start), edges(end));
    if stay_apart([&start_a, &end_a], [&start_b, &end_b], separation, &mut DVec3::default()) {
        return None;
    }
    let later = |first: usize, second: usize| is_later(start, end, first, second);
    let ordered = |first: usize, second: usize| if later(first, second) { [second, first] } else { [first, second] };
    let (mut a, mut b) = (ordered(0, 1), ordered(2, 3));
    let is_swapped = later(a[0], b[0]) || !later(b[0], a[0]) && later(a[1], b[1]);
    if is_swapped {
        (a, b) = (b, a);
    }
    let corners = [[a[0], b[0]], [a[1], b[0]], [a[1], b[1]], [a[0], b[1]]];
    let differences = |points: &[DVec3; 4]| corners.map(|[a, b]| points[a] - points[b]);
    let Arrival { time, cause, normal, place: [on_a, on_b], steps } =
        MovingHull::new(differences(start), differences(end))?.arrival(separation, from, until)?;
    let mut weights = [0.0; 4];
    for (ends, along) in [(a, on_a), (b, on_b)] {
        weights[ends[0]] = 1.0 - along;
        weights[ends[1]] = along;
    }
    Some(FeatureImpact { time, cause, weights, normal: if is_swapped { normal } else { -normal }, steps })
}

/// Whether one moving point comes after another, in an order that depends only on their coordinates. The result is then
/// the same from either side, to the last bit.
fn is_later(start: &[DVec3; 4], end: &[DVec3; 4], first: usize, second: usize) -> bool {
    let key = |point: usize| (start[point].to_array(), end[point].to_array());
    key(first) > key(second)
}
