//! Finds which triangles of a pair of surfaces cross, and which cut-off part moves back.

use bevy_platform::collections::HashSet;

use super::{Gatherer, Scene};
use crate::{
    contacts::StoredPair,
    kernel::mesh::{
        feature::{Feature, FeatureKind},
        side::face_normal,
    },
    response::{
        particles::Particles,
        untangle::{CutOff, PiercingEdge, cut_off},
    },
};

impl Gatherer {
    /// How often the triangles around a corner of two that cross do so, on average.
    pub(super) fn crowd(&self, corners: [[u32; 3]; 2]) -> f64 {
        let crossings = corners.iter().flatten().filter_map(|corner| self.tangled.get(corner));
        f64::from(crossings.sum::<u32>()) / 6.0
    }

    /// Finds the crossings of two surfaces without an inside, or of a body with itself.
    pub(super) fn find_tangled(&mut self, particles: &mut Particles, scene: &Scene<'_, '_>, pair: &StoredPair) {
        self.tangled.clear();
        self.back = None;
        let is_own = pair.a == pair.b;
        if pair.nearest > 0.0 || !is_own && pair.one_sided.contains(&true) {
            return;
        }
        let Some(topology_b) = &pair.topology_b else { return };
        let topologies = [&pair.topology_a, topology_b];
        let sides = self.sides(pair);
        let mut piercing: [Vec<PiercingEdge>; 2] = [Vec::new(), Vec::new()];
        let mut crossing: [HashSet<u32>; 2] = [HashSet::new(), HashSet::new()];
        for record in pair.contacts.iter() {
            if record.features.kind() != FeatureKind::EdgeFace {
                continue;
            }
            let triangles = [record.triangle_a, record.triangle_b];
            let corners = [0, 1].map(|k| self.corners(particles, scene, &sides[k], &pair.poses[k], triangles[k]));
            let [Some(corners_a), Some(corners_b)] = corners else { continue };
            for corner in corners_a.into_iter().chain(corners_b) {
                *self.tangled.entry(corner).or_default() += 1;
            }
            let at = |corner: u32| particles.start[corner as usize];
            for (k, feature) in [record.features.a, record.features.b].into_iter().enumerate() {
                crossing[k].extend(topologies[k].triangles_beside(triangles[k]));
                let Feature::Edge(edge) = feature else { continue };
                let [own, other] = if k == 0 { [corners_a, corners_b] } else { [corners_b, corners_a] };
                let normal = |_| face_normal(&other.map(at));
                piercing[k].push(PiercingEdge::new(topologies[k], triangles[k], edge, own.map(at), normal));
            }
        }
        if self.tangled.is_empty() {
            return;
        }
        let names = [pair.a.entity(), pair.b.entity()];
        if is_own {
            for triangles in &crossing {
                self.insides.let_pass(names[0], names[0], triangles);
            }
            return;
        }
        let mut least: Option<(usize, CutOff)> = None;
        for k in [0, 1] {
            self.insides.let_pass(names[k], names[1 - k], &crossing[k]);
            if self.first_particle(names[k]).is_none() {
                continue;
            }
            let part = cut_off(topologies[k].vertex_count(), topologies[k].edges(), &piercing[k]);
            let is_less = |part: &CutOff| least.as_ref().is_none_or(|(_, least)| part.share < least.share);
            least = part.filter(is_less).map(|part| (k, part)).or(least);
        }
        if let Some((k, part)) = least
            && let Some(first) = self.first_particle(names[k])
        {
            let particles = part.vertices.iter().map(|&vertex| first as u32 + vertex);
            self.insides.let_leave(names[1 - k], particles);
            self.back = Some(if k == 0 { part.back } else { -part.back });
        }
    }
}
