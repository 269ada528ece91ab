//! Memory use, by component and resource.
//!
//! Components and resources are removed from the world one after the other, and the allocator reports how many bytes
//! each removal frees. The sum is complete, because the remainder is reported too. Memory per triangle is measured on a
//! sheet without pairs: it is tested against a triangle within its box that is not near any triangle of the sheet.
//! Memory per pair is measured on a crumpled sheet. Self-collision with an exact method adds six numbers per triangle
//! to the topology, which are part of the remainder.

use std::fmt::{self, Display, Formatter};

use bevy_circumsphere::{
    Circumspheres, EnclosingBalls, TriangleCones, TriangleCurvature,
    detection::{
        CandidateTrianglePairs, ExactTrianglePairs, KeptPairs, MeetingCaps, OverlappingTrianglePairs, SphereContacts,
        SurfaceStates,
    },
    geometry::SurfaceTopology,
    prelude::*,
};
use bevy_ecs::prelude::*;
use serde::Serialize;

use super::{
    super::{
        HEAP,
        report::{grouped, short},
    },
    Stage,
    scenes::{self, Scene},
};

/// Number of ticks before memory is measured, because buffers are swapped and reused between ticks.
const TICKS: usize = 4;

/// Memory of one method.
#[derive(Serialize)]
pub struct Memory {
    pub method: String,
    pub triangles: usize,
    /// All memory of a sheet without pairs, plus the rows that only a sheet with pairs has.
    pub bytes_per_triangle_without_pairs: f64,
    candidates: usize,
    contacts: usize,
    parts: Vec<Part>,
    bytes_per_candidate: f64,
    bytes_per_contact: f64,
    listed: usize,
    /// `None` if nothing is listed.
    bytes_per_listed: Option<f64>,
    /// Peak memory during a tick, less the memory that remains after it.
    passing_bytes_per_candidate: f64,
}

/// One component or resource.
#[derive(Serialize)]
struct Part {
    name: &'static str,
    /// For the sheet without pairs. Rows are measured on the crumpled sheet, because the other one has none.
    bytes_per_triangle: f64,
    /// For the crumpled sheet.
    bytes: usize,
}

/// The memory of a sheet, by component and resource.
struct Weighed {
    parts: Vec<(&'static str, usize)>,
    candidates: usize,
    contacts: usize,
    /// Pairs in lists that outlive a tick.
    listed: usize,
    /// Peak memory during a tick, less the memory that remains after it.
    passing: usize,
}

const TOPOLOGY: &str = "topology";
/// Positions, boxes, tree, and rows.
const STATES: &str = "SurfaceStates";
const CANDIDATES: &str = "CandidateTrianglePairs";
const LISTS: &str = "KeptPairs (lists of near pairs)";
/// Memory that is private to the stages.
const ELSEWHERE: &str = "elsewhere (scratch)";

/// Resources that hold pairs that were found, as opposed to candidates.
const RESULTS: [&str; 6] =
    ["OverlappingTrianglePairs", "MeetingCaps", "ExactTrianglePairs", "SphereContacts", "ContactStore", ELSEWHERE];

/// Removes a component of the sheet, or a resource.
type Take = fn(&mut World, Entity);

fn take_component<T: Component>(world: &mut World, surface: Entity) {
    world.entity_mut(surface).remove::<T>();
}

fn take_resource<T: Resource>(world: &mut World, _: Entity) {
    world.remove_resource::<T>();
}

fn weigh(scene: &Scene, method: ContactMethod) -> Weighed {
    let body = &scene.bodies[0];
    // The topology is shared by several owners and freed with the last one, so it is measured separately.
    let before = HEAP.current_usage();
    let topology = SurfaceTopology::new(&body.states[0].positions, &body.triangles).expect("it is a valid mesh");
    let topology_bytes = HEAP.current_usage() - before;
    drop(topology);

    let before = HEAP.current_usage();
    // Subtract the memory of an empty app.
    let empty = Stage::new(&Scene { bodies: Vec::new(), ..*scene }, method);
    let empty_bytes = HEAP.current_usage() - before;
    drop(empty);

    let before = HEAP.current_usage();
    let mut stage = Stage::new(scene, method);
    let mut passing = 0;
    for _ in 0..TICKS {
        stage.advance(scene);
        HEAP.reset_peak_usage();
        stage.app.update();
        passing = HEAP.peak_usage() - HEAP.current_usage();
    }
    // After a small motion, the mesh also has lists of near pairs.
    stage.creep();
    stage.app.update();
    let listed = stage.app.world().resource::<KeptPairs>().listed();
    let whole = (HEAP.current_usage() - before).saturating_sub(empty_bytes);
    let size = stage.size(scene);
    let holders: [(&'static str, Take); 13] = [
        ("SurfacePositions", take_component::<SurfacePositions>),
        ("TriangleCurvature", take_component::<TriangleCurvature>),
        ("EnclosingBalls", take_component::<EnclosingBalls>),
        ("Circumspheres", take_component::<Circumspheres>),
        ("TriangleCones", take_component::<TriangleCones>),
        (STATES, take_resource::<SurfaceStates>),
        (CANDIDATES, take_resource::<CandidateTrianglePairs>),
        (LISTS, take_resource::<KeptPairs>),
        ("OverlappingTrianglePairs", take_resource::<OverlappingTrianglePairs>),
        ("MeetingCaps", take_resource::<MeetingCaps>),
        ("ExactTrianglePairs", take_resource::<ExactTrianglePairs>),
        ("SphereContacts", take_resource::<SphereContacts>),
        ("ContactStore", take_resource::<bevy_circumsphere::ContactStore>),
    ];
    let mut parts = vec![(TOPOLOGY, topology_bytes)];
    for (name, take) in holders {
        let before = HEAP.current_usage();
        take(stage.app.world_mut(), stage.surfaces[0]);
        parts.push((name, before.saturating_sub(HEAP.current_usage())));
    }
    let named: usize = parts.iter().map(|&(_, bytes)| bytes).sum();
    parts.push((ELSEWHERE, whole.saturating_sub(named)));
    Weighed { parts, candidates: size.candidates, contacts: size.contacts, listed, passing }
}

impl Memory {
    pub fn measure(method: ContactMethod, triangles: usize) -> Self {
        let (lone, crumpled) = (scenes::lone(triangles), scenes::crumpled(triangles));
        let (without, with) = (weigh(&lone, method), weigh(&crumpled, method));
        assert_eq!(without.candidates, 0, "the lone sheet must have no candidates");
        let lone_triangles = lone.triangles() as f64;
        let parts: Vec<Part> = without
            .parts
            .iter()
            .zip(&with.parts)
            .map(|(&(name, lone), &(_, bytes))| Part { name, bytes_per_triangle: lone as f64 / lone_triangles, bytes })
            .collect();
        let bytes = |names: &[&str]| {
            parts.iter().filter(|part| names.contains(&part.name)).map(|part| part.bytes).sum::<usize>() as f64
        };
        Self {
            method: format!("{method:?}"),
            triangles: crumpled.triangles(),
            bytes_per_triangle_without_pairs: parts.iter().map(|part| part.bytes_per_triangle).sum(),
            candidates: with.candidates,
            contacts: with.contacts,
            bytes_per_candidate: bytes(&[CANDIDATES]) / with.candidates as f64,
            listed: with.listed,
            bytes_per_listed: (with.listed > 0).then(|| bytes(&[LISTS]) / with.listed as f64),
            bytes_per_contact: bytes(&RESULTS) / with.contacts as f64,
            passing_bytes_per_candidate: with.passing as f64 / with.candidates as f64,
            parts,
        }
    }
}

impl Display for Memory {
    fn fmt(&self, out: &mut Formatter<'_>) -> fmt::Result {
        let counts = [self.triangles, self.candidates, self.contacts].map(|count| grouped(count as u64));
        writeln!(
            out,
            "memory, {}: {} triangles, {} candidates, {} contacts",
            self.method, counts[0], counts[1], counts[2]
        )?;
        writeln!(out, "{:44} {:>14} {:>14}", "", "without pairs", "crumpled")?;
        writeln!(out, "{:44} {:>14} {:>14}", "", "bytes per △", "bytes")?;
        for part in self.parts.iter().filter(|part| part.bytes > 0) {
            writeln!(out, "    {:40} {:>14.1} {:>14}", part.name, part.bytes_per_triangle, grouped(part.bytes as u64))?;
        }
        writeln!(
            out,
            "{} bytes per triangle; {} per candidate in its list; {} per contact in all results; temporarily {} per \
             candidate",
            short(self.bytes_per_triangle_without_pairs),
            short(self.bytes_per_candidate),
            short(self.bytes_per_contact),
            short(self.passing_bytes_per_candidate)
        )?;
        if let Some(bytes) = self.bytes_per_listed {
            let listed = grouped(self.listed as u64);
            writeln!(
                out,
                "{} bytes for each of {listed} pairs in lists of near pairs, after a small motion",
                short(bytes)
            )?;
        }
        Ok(())
    }
}
