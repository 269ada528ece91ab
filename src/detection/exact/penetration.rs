//! The last step of the exact test of a pair: resolves its penetrations, on several threads.

use crate::{
    detection::parallel::fill_chunks,
    kernel::{
        exact::penetration::{Finding, PenetrationTest},
        pair::{FoundPairs, PairSettings, SurfaceSide},
    },
};

/// Contacts per task. Each takes as long as several pairs of triangles.
const CHUNK: usize = 256;

/// Memory of the step.
#[derive(Default)]
pub(in crate::detection) struct PenetrationBuffers {
    test: PenetrationTest,
    findings: Vec<Finding>,
}

impl PenetrationBuffers {
    /// Resolves the penetrations among the contacts of a pair of surfaces.
    pub(in crate::detection) fn resolve(
        &mut self,
        [a, b]: [&SurfaceSide<'_>; 2],
        candidates: &[[u32; 2]],
        settings: &PairSettings,
        threads: usize,
        found: &mut FoundPairs,
    ) {
        let Self { test, findings } = self;
        let contacts = &mut found.contacts;
        test.prepare(a, b, candidates, settings, contacts);
        findings.clear();
        findings.resize(test.questions().len(), Finding::default());
        fill_chunks(test.questions(), findings, CHUNK, threads, |_, questions, findings| {
            test.look(a, b, contacts, questions, findings);
        });
        let count = contacts.len();
        test.apply(findings, settings, contacts);
        if contacts.len() < count {
            found.shared.clear();
            found.finish_contacts(0);
        }
    }
}
