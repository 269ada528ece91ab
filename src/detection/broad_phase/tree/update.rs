//! Refits trees to the boxes of their surfaces: one large surface in tasks, many small ones in parallel. Rebuilds a
//! tree that has decayed.

use std::sync::Arc;

use bevy_platform::time::Instant;

use crate::{
    detection::{
        broad_phase::REBUILD_DECAY,
        parallel::{Threads, for_each_weighed},
        state::{
            SurfaceState, SurfaceStates,
            bounds::TriangleBounds,
            tree::{Outcome, SurfaceTree},
        },
    },
    surface::{ActiveSurface, ActiveSurfaces},
};

/// A decayed tree is rebuilt in slices, one per tick. If it has decayed this far before the slices begin, everything
/// has changed at once. It is then rebuilt immediately, because searching it until the last slice would take longer.
const REBUILD_AT_ONCE_DECAY: f32 = 4.0;

/// The same limit once the slices have begun.
const BREAK_OFF_DECAY: f32 = 16.0;

/// Half the number of triangles from which a surface is worth several threads.
const TRIANGLES_OF_ONE: usize = 8192;

impl SurfaceTree {
    /// Whether it was built for the surface's current mesh.
    pub(super) fn is_of(&self, surface: &ActiveSurface) -> bool {
        self.topology.as_ref().is_some_and(|topology| Arc::ptr_eq(topology, &surface.topology))
    }

    /// Refits or rebuilds the tree to the boxes of its surface.
    pub(super) fn update(&mut self, surface: &ActiveSurface, bounds: &TriangleBounds, threads: usize) -> Outcome {
        let mut outcome = Outcome::default();
        if self.is_of(surface) {
            if self.version != bounds.version() {
                // The tree has been idle, so a rebuild in progress is based on outdated boxes.
                if bounds.version() != self.version + 1 {
                    self.tree.break_off_rebuilding();
                }
                let boxes = bounds.triangles_on(&Threads(threads));
                outcome.is_rebuilt = self.tree.go_on_rebuilding();
                self.tree.refit_on(&Threads(threads), boxes);
                let has_begun = self.tree.is_rebuilding();
                if self.tree.decay() > if has_begun { BREAK_OFF_DECAY } else { REBUILD_AT_ONCE_DECAY } {
                    self.tree.rebuild(boxes);
                    outcome.is_rebuilt = true;
                } else if self.tree.decay() > REBUILD_DECAY && !has_begun {
                    self.tree.begin_rebuild(boxes);
                }
            }
        } else {
            let build = Instant::now();
            self.tree.rebuild(bounds.triangles_on(&Threads(threads)));
            self.topology = Some(Arc::clone(&surface.topology));
            outcome.first_build = build.elapsed();
        }
        self.version = bounds.version();
        outcome
    }
}

/// Calls `update` with every active surface: its index, its state, the surface, and the number of threads for it.
pub(super) fn update_each(
    active: &ActiveSurfaces,
    states: &mut SurfaceStates,
    threads: usize,
    update: impl Fn(usize, &mut SurfaceState, &ActiveSurface, usize) + Sync,
) {
    let surfaces = &active.surfaces;
    for_each_weighed(
        states.all_mut(),
        threads,
        TRIANGLES_OF_ONE,
        |place, _| surfaces[place].topology.triangles().len(),
        |place, state, threads| update(place, state, &surfaces[place], threads),
    );
}
