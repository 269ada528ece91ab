//! The last step of the exact test of a pair: settles its penetrations, on several threads.

use crate::{
    detection::parallel::fill_chunks,
    kernel::{
        exact::penetration::{Finding, Settling},
        pair::{FoundPairs, PairSettings, SurfaceSide},
    },
};

/// Contacts per task. Each takes as long as several pairs of triangles.
const CHUNK: usize = 256;

/// Memory of the step.
#[derive(Default)]
pub(in crate::detection) struct SettleBuffers {
    settling: Settling,
    findings: Vec<Finding>,
}

impl SettleBuffers {
    /// Settles the penetrations among the contacts of a pair of surfaces.
    pub(in crate::detection) fn settle(
        &mut self,
        [a, b]: [&SurfaceSide<'_>; 2],
        candidates: &[[u32; 2]],
        settings: &PairSettings,
        threads: usize,
        found: &mut FoundPairs,
    ) {
        let Self { settling, findings } = self;
        let contacts = &mut found.contacts;
        settling.prepare(a, b, candidates, settings, contacts);
        findings.clear();
        findings.resize(settling.questions().len(), Finding::default());
        fill_chunks(settling.questions(), findings, CHUNK, threads, |_, questions, findings| {
            settling.look(a, b, contacts, questions, findings);
        });
        let count = contacts.len();
        settling.carry_out(findings, settings, contacts);
        if contacts.len() < count {
            found.shared.clear();
            found.finish_contacts(0);
        }
    }
}
