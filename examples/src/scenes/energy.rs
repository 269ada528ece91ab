//! The energy of a scene's bodies.

use bevy_circumsphere::{
    geometry::EdgeId,
    geometry::SurfaceTopology,
    response::{XpbdBody, XpbdMaterial, XpbdSettings},
};
use bevy_ecs::component::Component;
use glam::DVec3;

use super::Stage;

/// Energy in joules of everything that is not pinned.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Energy {
    /// Kinetic energy.
    pub kinetic: f64,
    /// Potential energy in gravity, relative to the world's origin.
    pub height: f64,
    /// Elastic energy of springs and hinges with positive, finite compliance. Those with compliance 0 store none.
    pub elastic: f64,
}

impl Energy {
    /// The energy of the bodies in their current state.
    pub fn of(stage: &Stage) -> Self {
        let gravity = stage.app.world().resource::<XpbdSettings>().gravity.as_dvec3();
        let mut energy = Self::default();
        for &entity in &stage.bodies {
            let body = stage.app.world().get::<XpbdBody>(entity).expect("bodies are never removed");
            energy.kinetic += body.kinetic_energy();
            let masses =
                body.inverse_masses.iter().map(|&inverse| if inverse > 0.0 { 1.0 / f64::from(inverse) } else { 0.0 });
            let heights = stage.positions(entity).iter().map(|position| -gravity.dot(position.as_dvec3()));
            energy.height += masses.zip(heights).map(|(mass, height)| mass * height).sum::<f64>();
            let now: Vec<DVec3> = stage.positions(entity).iter().map(|position| position.as_dvec3()).collect();
            let topology = stage.surface(entity).topology();
            let rest = stage.app.world().get::<RestEdges>(entity).expect("bodies are never removed");
            energy.elastic += rest.elastic_energy(&body.material, topology, &now);
        }
        energy
    }

    pub fn total(&self) -> f64 {
        self.kinetic + self.height + self.elastic
    }
}

/// The edges of a body at rest.
#[derive(Component, Clone, Debug)]
pub struct RestEdges {
    lengths: Vec<f64>,
    /// The edges between two triangles, with the angle between these.
    bends: Vec<(EdgeId, f64)>,
}

impl RestEdges {
    pub fn new(topology: &SurfaceTopology, positions: &[DVec3]) -> Self {
        let edges = (0..topology.edges().len() as u32).map(EdgeId);
        Self {
            lengths: lengths(topology, positions).collect(),
            bends: edges.filter_map(|edge| Some((edge, bend(topology, positions, edge)?))).collect(),
        }
    }

    /// Half the square of each stretch and bend, divided by its compliance.
    fn elastic_energy(&self, material: &XpbdMaterial, topology: &SurfaceTopology, positions: &[DVec3]) -> f64 {
        let gives = |compliance: f32| compliance > 0.0 && compliance.is_finite();
        let half = |compliance: f32| 1.0 / (2.0 * f64::from(compliance));
        let mut energy = 0.0;
        if gives(material.stretch_compliance) {
            let stretches = lengths(topology, positions).zip(&self.lengths).map(|(length, rest)| length - rest);
            energy += stretches.map(|stretch| stretch * stretch).sum::<f64>() * half(material.stretch_compliance);
        }
        if gives(material.bend_compliance) {
            let bends = self.bends.iter().filter_map(|&(edge, rest)| Some(bend(topology, positions, edge)? - rest));
            energy += bends.map(|bend| bend * bend).sum::<f64>() * half(material.bend_compliance);
        }
        energy
    }
}

fn lengths(topology: &SurfaceTopology, positions: &[DVec3]) -> impl Iterator<Item = f64> {
    topology.edges().iter().map(|&[start, end]| positions[start as usize].distance(positions[end as usize]))
}

/// The angle between the normals of the two triangles at an edge, in radians, positive if convex. `None` if there are not two.
fn bend(topology: &SurfaceTopology, points: &[DVec3], edge: EdgeId) -> Option<f64> {
    let &[one, other] = topology.triangles_of_edge(edge) else { return None };
    let corners = |triangle: u32| topology.welded_triangles()[triangle as usize];
    let [first, second] = [one, other].map(|triangle| {
        let [a, b, c] = corners(triangle).map(|corner| points[corner as usize]);
        (b - a).cross(c - a)
    });
    let [start, end] = topology.edges()[edge.0 as usize];
    let apex = corners(other).into_iter().find(|&corner| corner != start && corner != end);
    let to_apex = apex.map_or(DVec3::ZERO, |apex| points[apex as usize] - points[start as usize]);
    let angle = first.cross(second).length().atan2(first.dot(second));
    Some(if first.dot(to_apex) > 0.0 { -angle } else { angle })
}
