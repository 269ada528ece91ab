//! The energy of a scene's bodies.

use bevy_circumsphere::{
    geometry::EdgeId,
    geometry::SurfaceTopology,
    response::{XpbdBody, XpbdMaterial, XpbdSettings},
};
use glam::{DVec3, Vec3};

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
            let topology = stage.surface(entity).topology();
            energy.elastic += elastic(topology, &body.material, stage.positions(entity), stage.rest(entity));
        }
        energy
    }

    pub fn total(&self) -> f64 {
        self.kinetic + self.height + self.elastic
    }
}

/// Half the square of each stretch and bend, divided by its compliance.
fn elastic(topology: &SurfaceTopology, material: &XpbdMaterial, positions: &[Vec3], rest: &[DVec3]) -> f64 {
    let gives = |compliance: f32| compliance > 0.0 && compliance.is_finite();
    let now: Vec<DVec3> = positions.iter().map(|position| position.as_dvec3()).collect();
    let edges = || (0..).map(EdgeId).zip(topology.edges());
    let mut energy = 0.0;
    if gives(material.stretch_compliance) {
        let length = |points: &[DVec3], ends: &[u32; 2]| points[ends[0] as usize].distance(points[ends[1] as usize]);
        let stretches = edges().map(|(_, ends)| length(&now, ends) - length(rest, ends));
        energy +=
            stretches.map(|stretch| stretch * stretch).sum::<f64>() / (2.0 * f64::from(material.stretch_compliance));
    }
    if gives(material.bend_compliance) {
        let bends = edges().filter_map(|(edge, _)| {
            let &[first, second] = topology.triangles_of_edge(edge) else { return None };
            Some(bend(topology, &now, edge, [first, second]) - bend(topology, rest, edge, [first, second]))
        });
        energy += bends.map(|bend| bend * bend).sum::<f64>() / (2.0 * f64::from(material.bend_compliance));
    }
    energy
}

/// The angle between the normals of two triangles at their common edge, in radians, positive if convex.
fn bend(topology: &SurfaceTopology, points: &[DVec3], edge: EdgeId, triangles: [u32; 2]) -> f64 {
    let [first, second] = triangles.map(|triangle| {
        let [a, b, c] = topology.welded_triangles()[triangle as usize].map(|corner| points[corner as usize]);
        (b - a).cross(c - a)
    });
    let [start, end] = topology.edges()[edge.0 as usize];
    let apex =
        topology.welded_triangles()[triangles[1] as usize].into_iter().find(|&corner| corner != start && corner != end);
    let to_apex = apex.map_or(DVec3::ZERO, |apex| points[apex as usize] - points[start as usize]);
    let angle = first.cross(second).length().atan2(first.dot(second));
    if first.dot(to_apex) > 0.0 { -angle } else { angle }
}
