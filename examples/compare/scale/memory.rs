//! Where the bytes are.
//!
//! What holds them is taken away from the world one after the other, and the allocator is asked each time how much that has
//! freed: nothing is left out, as what remains is stated too. Memory per triangle is that of a sheet that is tested against
//! something in its box, and none of whose triangles is near it: no pair takes any. Pairs are weighed on a crumpled sheet.
//! What its topology adds once it meets itself under an exact method, six numbers a triangle, is among what is elsewhere.

use std::fmt::{self, Display, Formatter};

use bevy_circumsphere::{
    detection::{
        CandidateTrianglePairs, Circumspheres, EnclosingBalls, KeptPairs, MeetingCaps, OverlappingTrianglePairs,
        RefinedTrianglePairs, SphereContacts, SurfaceRows, TriangleBounds, TriangleCones, TriangleCurvature,
        broad_phase::SurfaceTree,
    },
    kernel::mesh::topology::SurfaceTopology,
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

/// Ticks before anything is weighed: buffers are swapped and reused from tick to tick.
const TICKS: usize = 4;

/// What one method holds.
#[derive(Serialize)]
pub struct Memory {
    pub method: String,
    pub triangles: usize,
    /// All that a sheet without pairs takes, wherever it is, and the rows that it has with them.
    pub bytes_per_triangle_without_pairs: f64,
    candidates: usize,
    contacts: usize,
    parts: Vec<Part>,
    bytes_per_candidate: f64,
    bytes_per_contact: f64,
    listed: usize,
    /// None where nothing is listed.
    bytes_per_listed: Option<f64>,
    /// The most that a tick takes beyond what it leaves behind.
    passing_bytes_per_candidate: f64,
}

/// One component or resource.
#[derive(Serialize)]
struct Part {
    name: &'static str,
    /// Of the sheet without pairs; of rows, which it does not have, of the crumpled one.
    bytes_per_triangle: f64,
    /// Of the crumpled sheet.
    bytes: usize,
}

/// What a sheet takes, by what holds it.
struct Weighed {
    parts: Vec<(&'static str, usize)>,
    candidates: usize,
    contacts: usize,
    /// Pairs on lists that outlive a tick.
    listed: usize,
    /// Beyond what stays, at the worst moment of a tick.
    passing: usize,
}

const TOPOLOGY: &str = "topology";
/// What a sheet has only where it is in many pairs, as much as a triangle takes.
const ROWS: &str = "SurfaceRows";
const CANDIDATES: &str = "CandidateTrianglePairs";
const LISTS: &str = "KeptPairs (of a mesh that moves a little)";
/// What only the stages themselves can reach.
const ELSEWHERE: &str = "elsewhere (scratch)";

/// What holds the pairs that were found, rather than candidates.
const RESULTS: [&str; 6] =
    ["OverlappingTrianglePairs", "MeetingCaps", "RefinedTrianglePairs", "SphereContacts", "ContactStore", ELSEWHERE];

/// Takes something away from the world, or from the sheet.
type Take = fn(&mut World, Entity);

fn take_component<T: Component>(world: &mut World, surface: Entity) {
    world.entity_mut(surface).remove::<T>();
}

fn take_resource<T: Resource>(world: &mut World, _: Entity) {
    world.remove_resource::<T>();
}

fn weigh(scene: &Scene, method: ContactMethod) -> Weighed {
    let body = &scene.bodies[0];
    // Shared by whoever refers to it, so it is not freed before the last one is.
    let before = HEAP.current_usage();
    let topology = SurfaceTopology::new(&body.states[0].positions, &body.triangles).expect("a scene has meshes");
    let topology_bytes = HEAP.current_usage() - before;
    drop(topology);

    let before = HEAP.current_usage();
    // What an app takes with nothing in it is not the sheet's.
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
    // A mesh that moves a little has lists besides.
    stage.creep();
    stage.app.update();
    let listed = stage.app.world().resource::<KeptPairs>().listed();
    let whole = (HEAP.current_usage() - before).saturating_sub(empty_bytes);
    let size = stage.size(scene);
    let holders: [(&'static str, Take); 15] = [
        ("SurfacePositions", take_component::<SurfacePositions>),
        ("TriangleBounds", take_component::<TriangleBounds>),
        ("SurfaceTree", take_component::<SurfaceTree>),
        ("TriangleCurvature", take_component::<TriangleCurvature>),
        ("EnclosingBalls", take_component::<EnclosingBalls>),
        ("Circumspheres", take_component::<Circumspheres>),
        ("TriangleCones", take_component::<TriangleCones>),
        (ROWS, take_component::<SurfaceRows>),
        (CANDIDATES, take_resource::<CandidateTrianglePairs>),
        (LISTS, take_resource::<KeptPairs>),
        ("OverlappingTrianglePairs", take_resource::<OverlappingTrianglePairs>),
        ("MeetingCaps", take_resource::<MeetingCaps>),
        ("RefinedTrianglePairs", take_resource::<RefinedTrianglePairs>),
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
        assert_eq!(without.candidates, 0, "the lone sheet is for what no pair takes");
        let lone_triangles = lone.triangles() as f64;
        let parts: Vec<Part> = without
            .parts
            .iter()
            .zip(&with.parts)
            .map(|(&(name, lone), &(_, bytes))| {
                let per_triangle = lone as f64 / lone_triangles;
                let bytes_per_triangle =
                    if name == ROWS { bytes as f64 / crumpled.triangles() as f64 } else { per_triangle };
                Part { name, bytes_per_triangle, bytes }
            })
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
        writeln!(out, "{:44} {:>14} {:>14}", "", "bytes a △", "bytes")?;
        for part in self.parts.iter().filter(|part| part.bytes > 0) {
            writeln!(out, "    {:40} {:>14.1} {:>14}", part.name, part.bytes_per_triangle, grouped(part.bytes as u64))?;
        }
        writeln!(
            out,
            "{} bytes a triangle; {} a candidate in its list; {} a contact in all results; in passing {} a candidate",
            short(self.bytes_per_triangle_without_pairs),
            short(self.bytes_per_candidate),
            short(self.bytes_per_contact),
            short(self.passing_bytes_per_candidate)
        )?;
        if let Some(bytes) = self.bytes_per_listed {
            let listed = grouped(self.listed as u64);
            writeln!(
                out,
                "{} bytes for each of {listed} pairs that are listed while the mesh moves a little",
                short(bytes)
            )?;
        }
        Ok(())
    }
}
