//! Which features a pair of triangles reports, so that most features are reported once.

use fearless_simd::{mask64x8, prelude::*, u64x8};

use crate::kernel::{
    exact::{CaseLanes, Cases},
    mesh::{
        corner_rows::CornerRow,
        feature::{Feature, FeaturePair},
        ids::{EdgeId, TriangleId, VertexId},
        surroundings::SurroundingLanes,
        topology::share_corner,
    },
    pair::{PairSettings, RowPair, SurfaceSide},
    simd::lanes::WIDTH,
};

/// The features that a pair reports.
#[derive(Clone, Copy)]
pub(super) struct Reported {
    pub(super) cases: Cases,
    /// Those of them that other pairs may report too, and possibly others.
    pub(super) shared: Cases,
}

impl Reported {
    /// Adds a case if it is reported. `is_shared` is `None` if it is not.
    fn add(&mut self, case: Cases, is_shared: Option<bool>) {
        if let Some(is_shared) = is_shared {
            self.cases = self.cases.or(case);
            self.shared = if is_shared { self.shared.or(case) } else { self.shared };
        }
    }

    /// Whether other pairs may report these features too.
    pub(super) fn is_shared(self, features: FeaturePair) -> bool {
        let case = Cases::of(features);
        case.without_boundary().are_none() || self.shared.contain(case)
    }
}

/// The features that eight pairs report.
#[derive(Clone, Copy)]
pub(super) struct ReportedLanes<S: Simd> {
    pub(super) cases: CaseLanes<S>,
    pub(super) shared: CaseLanes<S>,
    /// Pairs that may report more than that.
    pub(super) others: mask64x8<S>,
}

impl<S: Simd> ReportedLanes<S> {
    /// All of some cases, whichever triangles are the first around their features.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(super) fn all(simd: S, cases: CaseLanes<S>) -> Self {
        Self { cases, shared: CaseLanes(u64x8::splat(simd, Cases::ALL.bits())), others: mask64x8::splat(simd, false) }
    }
}

/// The cases that eight pairs report because their triangles are the first around both features, see [`reports`].
#[cfg_attr(not(unoptimized), inline(always))]
pub(super) fn reported_as_first<S: Simd>(
    simd: S,
    rows: &[[&CornerRow; WIDTH]; 2],
    same_surface: bool,
    is_welded: bool,
    CaseLanes(cases): CaseLanes<S>,
) -> ReportedLanes<S> {
    let none = u64x8::splat(simd, 0);
    let surroundings = |side: usize| rows[side].map(|row| row.surroundings);
    let a = SurroundingLanes::new(simd, surroundings(0));
    let b = SurroundingLanes::new(simd, surroundings(1));
    let first = CaseLanes::between(a.first_of(), b.first_of());
    let shared = (a.are_collapsed() | b.are_collapsed()).select(u64x8::splat(simd, Cases::ALL.bits()), none);
    let rest = !(cases & !first.0 & Cases::ALL.without_boundary().bits()).simd_eq(none);
    let others = match (is_welded, same_surface) {
        (true, _) => rest,
        (false, true) => rest & a.firsts_may_meet(b),
        (false, false) => mask64x8::splat(simd, false),
    };
    ReportedLanes { cases: first, shared: CaseLanes(shared), others }
}

/// Adds the other cases that a pair reports although its triangles are not the first around their features.
#[inline(never)]
pub(super) fn add_others(pair: &RowPair<'_>, settings: &PairSettings, cases: Cases, reported: &mut Reported) {
    let [a, b] = pair.sides;
    let others = cases.without(reported.cases).without_boundary();
    if a.topology.is_welded() || b.topology.is_welded() {
        for case in others.each() {
            reported.add(case, reports(a, b, settings, pair.triangles, case.features()));
        }
        return;
    }
    for case in others.each() {
        let [part_a, part_b] = case.parts();
        let first_a = pair.rows[0].first_around(a.topology, part_a);
        let first_b = pair.rows[1].first_around(a.topology, part_b);
        let case = case.only_if(share_corner(first_a, first_b));
        (reported.cases, reported.shared) = (reported.cases.or(case), reported.shared.or(case));
    }
}

/// Whether this pair of triangles reports a feature pair, and if so, whether others may too. Only the pair of the first
/// triangles around both features reports it, unless these are neighbors, which are not a pair. Then every pair with
/// both features reports it, and only the first contact is kept later, as for boundary features. So it is if any pairs
/// are [left out](PairSettings::any_left_out).
pub(super) fn reports(
    a: &SurfaceSide<'_>,
    b: &SurfaceSide<'_>,
    settings: &PairSettings,
    triangles: [u32; 2],
    features: FeaturePair,
) -> Option<bool> {
    if settings.any_left_out
        || matches!(
            (features.a, features.b),
            (Feature::Vertex(_), Feature::Vertex(_) | Feature::Edge(_)) | (Feature::Edge(_), Feature::Vertex(_))
        )
    {
        return Some(true);
    }
    let first_around = |side: &SurfaceSide<'_>, triangle: u32, feature: Feature| {
        let around = triangles_around(side, triangle, feature).unwrap_or_default();
        around.iter().copied().find(|&candidate| shares_feature(side, triangle, feature, candidate)).unwrap_or(triangle)
    };
    let firsts = [first_around(a, triangles[0], features.a), first_around(b, triangles[1], features.b)];
    if firsts == triangles {
        let around = |side: &SurfaceSide<'_>, triangle: u32| side.topology.surroundings(TriangleId(triangle));
        return Some(around(a, triangles[0]).is_collapsed() || around(b, triangles[1]).is_collapsed());
    }
    let are_neighbors = settings.same_surface && a.topology.share_vertex(TriangleId(firsts[0]), TriangleId(firsts[1]));
    are_neighbors.then_some(true)
}

pub(in crate::kernel) fn triangles_around<'a>(
    side: &SurfaceSide<'a>,
    triangle: u32,
    feature: Feature,
) -> Option<&'a [u32]> {
    match feature {
        Feature::Vertex(corner) => {
            let vertex = side.topology.welded_triangles()[triangle as usize][corner as usize];
            Some(side.topology.triangles_of_vertex(VertexId(vertex)))
        }
        Feature::Edge(edge) => Some(
            side.topology.triangles_of_edge(EdgeId(side.topology.triangle_edges()[triangle as usize][edge as usize])),
        ),
        Feature::Face => None,
    }
}

/// Whether `candidate` still has the feature of `triangle` at the same place. Vertices that were welded at equal
/// positions may have moved apart since.
fn shares_feature(side: &SurfaceSide<'_>, triangle: u32, feature: Feature, candidate: u32) -> bool {
    if candidate == triangle || !side.topology.is_welded() {
        return true;
    }
    let same_corner = |corner: usize| {
        let vertex = side.topology.triangles()[triangle as usize][corner];
        let welded = side.topology.weld()[vertex as usize];
        let own = side.positions[vertex as usize];
        side.topology.triangles()[candidate as usize].iter().any(|&other| {
            other == vertex || side.topology.weld()[other as usize] == welded && side.positions[other as usize] == own
        })
    };
    match feature {
        Feature::Vertex(corner) => same_corner(corner as usize),
        Feature::Edge(edge) => same_corner(edge as usize) && same_corner((edge as usize + 1) % 3),
        Feature::Face => true,
    }
}
