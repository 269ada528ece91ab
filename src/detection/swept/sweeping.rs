//! A sweep of two meshes, distributed over threads.

use crate::{
    detection::parallel::{Buffers, append_ranges},
    kernel::{
        ccd::{PairImpact, SWEEP_PART, Sweep, SweepLeaves, sort_impacts},
        simd::parallel::Parallel,
    },
    surface::PairFilter,
};

/// Sweeps meshes on several threads. It keeps its memory.
#[derive(Default)]
pub(crate) struct Sweeping {
    leaves: SweepLeaves,
    candidates: Buffers<Vec<[u32; 2]>>,
    spare: Buffers<Vec<PairImpact>>,
}

impl Sweeping {
    /// Replaces `impacts` by those of a sweep, in the same order for any number of threads, without those that `filter`
    /// leaves out. Returns the number of pairs that were looked at one by one.
    pub(crate) fn run(
        &mut self,
        sweep: &Sweep<'_>,
        filter: Option<&PairFilter<'_>>,
        parallel: &impl Parallel,
        impacts: &mut Vec<PairImpact>,
    ) -> usize {
        impacts.clear();
        let Self { leaves, candidates, spare } = self;
        sweep.collect(parallel, leaves);
        let leaves = &*leaves;
        let work = |part, impacts: &mut Vec<PairImpact>| {
            candidates.with(|candidates| sweep.append_part(leaves, part, candidates, impacts))
        };
        let count = append_ranges(leaves.len(), SWEEP_PART, parallel, spare, impacts, work);
        sort_impacts(impacts);
        if let Some(filter) = filter {
            impacts.retain(|impact| filter.allows([impact.triangle_a, impact.triangle_b]));
        }
        count
    }
}
