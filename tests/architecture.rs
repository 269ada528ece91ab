//! The order of the folders of `src/`: which may import which, import cycles, the length of files, and where Bevy and the
//! operating system may be used.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::Path,
};

use petgraph::{algo::tarjan_scc, graphmap::DiGraphMap};

/// The folders of `src/`. Each may import from itself and from those before it. `kernel` is a single folder to the
/// others.
const ROOMS: [&str; 14] = [
    "kernel",
    "settings",
    "schedule",
    "diagnostics",
    "surface",
    "detection",
    "contacts",
    "spatial_query",
    "response",
    "rollback",
    "measurements",
    "debug",
    "reflect",
    "plugins",
];

/// The folders of the kernel, with the same rule.
const KERNEL_ROOMS: [&str; 17] = [
    "capacity",
    "pose",
    "simd",
    "mesh",
    "contact",
    "pair",
    "bvh",
    "spatial_hash",
    "exact",
    "smooth",
    "query",
    "spheres",
    "ccd",
    "tetrahedra",
    "xpbd",
    "pair_fate",
    "thin_wall",
];

/// The modules of std that WebAssembly has not, or has only to panic. The kernel leaves them to its callers.
const MISSING_ON_WASM: [&str; 7] = ["env", "fs", "net", "os", "process", "thread", "time"];

/// The most lines of a file.
const MOST_LINES: usize = 500;

/// A file of `src/` and the paths it imports, from the root of the crate.
struct Module {
    /// The file, relative to `src/`.
    file: String,
    /// Its module path.
    path: Vec<String>,
    lines: usize,
    imports: BTreeSet<Vec<String>>,
    /// Its re-exports: names, and the paths they stand for.
    exports: BTreeMap<String, Vec<String>>,
    /// The other crates that it names.
    crates: BTreeSet<String>,
    /// The modules of std that it names outside of tests.
    of_std: BTreeSet<String>,
}

/// The leaves of a `use` tree as paths: `a::{b, c::d}` is `a::b` and `a::c::d`.
fn leaves(tree: &str, before: &[String], found: &mut Vec<Vec<String>>) {
    let mut depth = 0;
    let parts = tree.split(|character| {
        match character {
            '{' => depth += 1,
            '}' => depth -= 1,
            _ => {}
        }
        character == ',' && depth == 0
    });
    for part in parts.map(str::trim).filter(|part| !part.is_empty()) {
        let (path, group) = part.split_once('{').map_or((part, None), |(path, group)| (path, Some(group)));
        let path = path.split(" as ").next().unwrap_or_default();
        let segments = path.split("::").map(str::trim).filter(|segment| !segment.is_empty()).map(str::to_owned);
        let path: Vec<String> = before.iter().cloned().chain(segments).collect();
        match group {
            Some(group) => leaves(group.trim_end().trim_end_matches('}'), &path, found),
            None => found.push(path),
        }
    }
}

/// A path as written in a module, from the root of the crate.
fn absolute(module: &[String], path: &[String]) -> Vec<String> {
    let ups = path.iter().take_while(|segment| *segment == "super").count().min(module.len());
    match path[0].as_str() {
        "crate" => path[1..].to_vec(),
        "self" => module.iter().chain(&path[1..]).cloned().collect(),
        _ => module[..module.len() - ups].iter().chain(&path[ups..]).cloned().collect(),
    }
}

/// Parses the imports of a file with the module path `path`.
fn parse(file: &str, path: &[String], source: &str) -> Module {
    let code: Vec<&str> = source.lines().map(|line| line.split("//").next().unwrap_or_default()).collect();
    let code = code.join("\n");
    let mut module = Module {
        file: file.to_owned(),
        path: path.to_vec(),
        lines: source.lines().count(),
        imports: BTreeSet::new(),
        exports: BTreeMap::new(),
        crates: BTreeSet::new(),
        of_std: BTreeSet::new(),
    };
    // Tests are at the end of a file.
    let tests = code.find("#[cfg(test)]").unwrap_or(code.len());
    for (start, _) in code[..tests].match_indices("std::") {
        let rest = &code[start + "std::".len()..tests];
        let end = rest.find([';', '(', ')', '<', '>', ' ', '\n']).unwrap_or(rest.len());
        let tree = if rest.starts_with('{') { rest.split(';').next().unwrap_or_default() } else { &rest[..end] };
        let mut paths = Vec::new();
        leaves(tree.trim_start_matches('{'), &[], &mut paths);
        module.of_std.extend(paths.into_iter().filter_map(|path| path.into_iter().next()));
    }
    let statements = code.split(';').filter_map(|statement| {
        let start = statement.rfind("use ").filter(|&start| {
            let before = statement[..start].trim_end();
            before.is_empty() || before.ends_with(['}', '{', ']', ')']) || before.ends_with("pub")
        })?;
        let line = statement[..start].rsplit('\n').next().unwrap_or_default();
        Some((line.trim_start().starts_with("pub"), statement[start + "use ".len()..].to_owned()))
    });
    let mut found = Vec::new();
    for (is_public, statement) in statements {
        let before = found.len();
        leaves(&statement, &[], &mut found);
        if is_public {
            for leaf in &found[before..] {
                let name = leaf.last().cloned().unwrap_or_default();
                module.exports.insert(name, absolute(path, leaf));
            }
        }
    }
    // Paths in the code itself.
    for (start, _) in code.match_indices("crate::") {
        let is_path = |character: char| character.is_alphanumeric() || character == '_' || character == ':';
        let text: String = code[start..].chars().take_while(|&character| is_path(character)).collect();
        leaves(&text, &[], &mut found);
    }
    for leaf in found {
        let ups = leaf.iter().take_while(|segment| *segment == "super").count();
        match leaf[0].as_str() {
            "crate" => _ = module.imports.insert(leaf[1..].to_vec()),
            // In a test module, this is one level too few, which is still the same folder or the one around it.
            "super" if ups <= path.len() => {
                let around = path[..path.len() - ups].iter().chain(&leaf[ups..]).cloned().collect();
                module.imports.insert(around);
            }
            "self" => _ = module.imports.insert(absolute(path, &leaf)),
            "super" => {}
            name => _ = module.crates.insert(name.to_owned()),
        }
    }
    module
}

/// A module from a text, for tests of the rules.
fn module(path: &str, source: &str) -> Module {
    let path: Vec<String> = path.split("::").map(str::to_owned).collect();
    parse(&path.join("/"), &path, source)
}

fn modules(folder: &Path, path: &[String], found: &mut Vec<Module>) {
    for entry in fs::read_dir(folder).expect("the folder can be listed").map(|entry| entry.expect("readable").path()) {
        let name = entry.file_stem().expect("files have names").to_string_lossy().into_owned();
        let own: Vec<String> = path.iter().cloned().chain([name.clone()]).collect();
        if entry.is_dir() {
            modules(&entry, &own, found);
        } else if entry.extension().is_some_and(|extension| extension == "rs") {
            let own = if name == "mod" || name == "lib" { path } else { &own };
            let source = fs::read_to_string(&entry).expect("sources are text");
            found.push(parse(&entry.display().to_string(), own, &source));
        }
    }
}

fn source_modules() -> Vec<Module> {
    let mut found = Vec::new();
    modules(&Path::new(env!("CARGO_MANIFEST_DIR")).join("src"), &[], &mut found);
    found
}

/// The file that defines the target of a path, if it is one of the modules. Re-exported names count where they are
/// defined.
fn file_of(modules: &BTreeMap<&[String], &Module>, path: &[String]) -> Option<usize> {
    let mut path = path.to_vec();
    // The most re-exports that a name may pass through.
    for _ in 0..8 {
        let length = (1..=path.len()).rev().find(|&length| modules.contains_key(&path[..length]))?;
        let (own, rest) = path.split_at(length);
        match rest.first().and_then(|name| modules[own].exports.get(name)) {
            Some(target) => path = target.iter().chain(&rest[1..]).cloned().collect(),
            None => return modules.keys().position(|other| *other == own),
        }
    }
    None
}

/// The most files that may import each other in a cycle.
const MOST_IN_A_CIRCLE: usize = 3;

/// The cycles of more files than that, one line each.
fn circles(modules: &[Module]) -> Vec<String> {
    let by_path: BTreeMap<&[String], &Module> = modules.iter().map(|module| (&*module.path, module)).collect();
    let mut graph = DiGraphMap::<usize, ()>::new();
    for (own, module) in by_path.values().enumerate() {
        for other in module.imports.iter().filter(|path| !module.exports.values().any(|export| export == *path)) {
            if let Some(other) = file_of(&by_path, other).filter(|&other| other != own) {
                graph.add_edge(own, other, ());
            }
        }
    }
    let files: Vec<&str> = by_path.values().map(|module| &*module.file).collect();
    let circles = tarjan_scc(&graph).into_iter().filter(|files| files.len() > MOST_IN_A_CIRCLE);
    circles.map(|circle| circle.into_iter().map(|file| files[file]).collect::<Vec<_>>().join(" ")).collect()
}

/// All violations of the rules, one line each.
fn faults(modules: &[Module]) -> Vec<String> {
    let place = |rooms: &[&str], name: &str| rooms.iter().position(|room| *room == name);
    let mut faults = Vec::new();
    for Module { file, path, lines, imports, crates, of_std, .. } in modules {
        if *lines > MOST_LINES {
            faults.push(format!("{file} has {lines} lines, more than {MOST_LINES}"));
        }
        let Some(room) = path.first() else { continue };
        let Some(own) = place(&ROOMS, room) else {
            faults.push(format!("{file}: {room} is an unknown folder"));
            continue;
        };
        for import in imports {
            let Some(other) = import.first().and_then(|name| place(&ROOMS, name)) else { continue };
            if other > own {
                faults.push(format!("{file} imports {} from a folder above", import.join("::")));
            }
        }
        if room != "kernel" {
            // A recording goes to a file, which a browser has not either.
            if of_std.contains("time") && !path.starts_with(&["debug".to_owned(), "rerun".to_owned()]) {
                faults.push(format!("{file} names std::time, which panics in browsers: use bevy_platform::time"));
            }
            continue;
        }
        for name in
            crates.iter().filter(|name| name.starts_with("bevy_") && *name != "bevy_math" && *name != "bevy_platform")
        {
            faults.push(format!("{file} imports {name} into the kernel"));
        }
        for name in of_std.iter().filter(|name| MISSING_ON_WASM.contains(&name.as_str())) {
            faults.push(format!("{file} names std::{name} in the kernel, which must run on WebAssembly"));
        }
        let Some(room) = path.get(1) else { continue };
        let Some(own) = place(&KERNEL_ROOMS, room) else {
            faults.push(format!("{file}: {room} is an unknown folder of the kernel"));
            continue;
        };
        for import in imports.iter().filter(|import| import.first().is_some_and(|name| name == "kernel")) {
            let Some(other) = import.get(1).and_then(|name| place(&KERNEL_ROOMS, name)) else { continue };
            if other > own {
                faults.push(format!("{file} imports {} from a folder above", import.join("::")));
            }
        }
    }
    faults
}

#[test]
fn rooms_import_only_from_rooms_below() {
    let modules = source_modules();
    assert!(modules.len() > 100, "the sources are found");
    let faults = faults(&modules);
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn no_more_than_three_files_import_each_other_in_a_circle() {
    let circles = circles(&source_modules());
    assert!(circles.is_empty(), "{}", circles.join("\n"));
}

#[test]
fn a_circle_of_four_files_is_found_and_one_of_three_is_allowed() {
    let ring = |last: &str| {
        [
            module("surface", "mod one;\nmod two;\nmod three;\nmod four;\npub use self::two::Two;\n"),
            module("surface::one", "use crate::surface::Two;\n"),
            module("surface::two", "use super::three::Three;\n"),
            module("surface::three", "use super::{four::Four, one::One};\n"),
            module("surface::four", last),
        ]
    };
    assert_eq!(circles(&ring("use glam::Vec3;\n")), Vec::<String>::new());
    let found = circles(&ring("use super::one::One;\n"));
    assert_eq!(found.len(), 1, "{found:?}");
    assert_eq!(found[0].split(' ').count(), 4, "{found:?}");
}

#[test]
fn what_breaks_the_rules_is_found() {
    let found = |path: &str, source: &str| faults(&[module(path, source)]);
    let long = "// A line.\n".repeat(MOST_LINES + 1);
    for (path, source) in [
        ("kernel::mesh::topology", "use crate::kernel::{pose::Pose, exact::stage::examine_pairs};\n"),
        ("kernel::mesh::topology", "use super::super::spheres::cone;\n"),
        ("kernel::mesh::topology", "fn first() { crate::kernel::bvh::tree::build(); }\n"),
        ("kernel::pose", "use bevy_ecs::prelude::*;\n"),
        ("kernel::misc", "\n"),
        ("kernel::pose", "use std::time::Instant;\n"),
        ("kernel::pose", "use std::{\n    sync::Arc,\n    time::{Duration, Instant},\n};\n"),
        ("kernel::pose", "fn first() { let now = std::time::Instant::now(); }\n"),
        ("kernel::pose", "fn first() { std::thread::scope(|scope| {}); }\n"),
        ("diagnostics", "use std::time::{Duration, Instant};\n"),
        ("debug::gizmos", "fn first() { let now = std::time::Instant::now(); }\n"),
        ("surface::components", "pub(crate) use crate::detection::Bounds;\n"),
        ("cellar::door", "\n"),
        ("contacts::store", &long),
    ] {
        assert_eq!(found(path, source).len(), 1, "{path}: {source}");
    }
    for right in [
        "use std::{\n    sync::Arc,\n    mem,\n};\nfn first() { std::mem::take(&mut 1); }\n",
        "#[cfg(test)]\nmod tests {\n    use std::time::Instant;\n}\n",
    ] {
        assert_eq!(found("kernel::pose", right), Vec::<String>::new());
    }
    assert_eq!(found("debug::rerun", "use std::time::Instant;\n"), Vec::<String>::new());
    assert_eq!(found("diagnostics", "use bevy_platform::time::Instant;\n"), Vec::<String>::new());
    let right =
        "use super::ids::VertexId;\nuse crate::kernel::{pose::Pose, simd::lanes::WIDTH};\n// use crate::detection;\n";
    assert_eq!(found("kernel::mesh::topology", right), Vec::<String>::new());
    assert_eq!(
        found("detection::bounds", "use crate::{kernel::mesh::bounds, surface::Active};\n"),
        Vec::<String>::new()
    );
}
