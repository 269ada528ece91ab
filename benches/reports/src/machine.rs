//! The machine and the build that produced the measurements.

use std::{
    fmt::{self, Display, Formatter},
    fs,
    process::Command,
};

use serde::Serialize;

#[derive(Serialize)]
pub struct Machine {
    pub processor: String,
    pub processors: usize,
    pub system: String,
    /// Relevant instruction sets that the processor supports.
    pub instruction_sets: Vec<&'static str>,
    /// Instruction sets that this program was compiled for. Kernels may use more, detected at run time.
    pub compiled_for: Vec<&'static str>,
    pub rustc: String,
    pub features: Vec<&'static str>,
    pub profile: &'static str,
    /// Load average over the last minute, before and after the measurements.
    pub load: [Option<f64>; 2],
}

fn processor() -> String {
    let text = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let field = |name: &str| {
        let line = text.lines().find(|line| line.starts_with(name))?;
        line.split_once(':').map(|(_, value)| value.trim().to_owned())
    };
    match (field("model name"), field("cpu family"), field("model\t")) {
        (Some(name), Some(family), Some(model)) => format!("{name} (family {family}, model {model})"),
        (Some(name), ..) => name,
        (None, ..) => std::env::consts::ARCH.to_owned(),
    }
}

/// The version of the compiler that cargo would use.
fn rustc() -> String {
    let program = std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    let output = Command::new(program).arg("--version").output().ok();
    output.map_or_else(|| "unknown".to_owned(), |output| String::from_utf8_lossy(&output.stdout).trim().to_owned())
}

/// Lists the names for which `$holds` is true.
macro_rules! held {
    ($holds:ident: $($name:tt),*) => {{
        let mut held = Vec::new();
        $(if $holds!($name) { held.push($name); })*
        held
    }};
}

#[cfg(target_arch = "x86_64")]
fn instruction_sets() -> Vec<&'static str> {
    use std::is_x86_feature_detected as has;
    held!(has: "sse4.2", "avx", "avx2", "fma", "avx512f")
}

#[cfg(not(target_arch = "x86_64"))]
fn instruction_sets() -> Vec<&'static str> {
    vec![std::env::consts::ARCH]
}

macro_rules! compiled {
    ($name:tt) => {
        cfg!(target_feature = $name)
    };
}

pub fn load() -> Option<f64> {
    fs::read_to_string("/proc/loadavg").ok()?.split(' ').next()?.parse().ok()
}

impl Machine {
    pub fn new(load: [Option<f64>; 2]) -> Self {
        Self {
            processor: processor(),
            processors: std::thread::available_parallelism().map_or(1, usize::from),
            system: format!("{} {}", std::env::consts::OS, std::env::consts::ARCH),
            instruction_sets: instruction_sets(),
            compiled_for: held!(compiled: "sse2", "sse4.2", "avx", "avx2", "fma", "avx512f", "neon"),
            rustc: rustc(),
            features: [("parallel", cfg!(feature = "parallel")), ("libm", cfg!(feature = "libm"))]
                .into_iter()
                .filter_map(|(name, is_on)| is_on.then_some(name))
                .collect(),
            profile: if cfg!(debug_assertions) { "with debug assertions (times are meaningless)" } else { "release" },
            load,
        }
    }
}

impl Display for Machine {
    fn fmt(&self, out: &mut Formatter<'_>) -> fmt::Result {
        let list = |names: &[&str]| if names.is_empty() { "none".to_owned() } else { names.join(" ") };
        writeln!(
            out,
            "measured on {}, {} processors, {}, instruction sets {}",
            self.processor,
            self.processors,
            self.system,
            list(&self.instruction_sets)
        )?;
        writeln!(
            out,
            "built with {} for {}, features {}, {}",
            self.rustc,
            list(&self.compiled_for),
            list(&self.features),
            self.profile
        )?;
        let load = self.load.map(|load| load.map_or_else(|| "unknown".to_owned(), |load| format!("{load:.1}")));
        writeln!(
            out,
            "machine load {} before, {} after (above 1, other programs took part of the time)",
            load[0], load[1]
        )
    }
}
