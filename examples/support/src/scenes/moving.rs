//! Scenes of several bodies that move and deform, for the report of the example `speed_vs_error`.
//!
//! Every position is a closed form of the rest position and the time, in `f64`, so that the motion is the same for any
//! number of ticks and any resolution. Lengths that determine contact are in mean edges, so that a scene touches alike
//! at every resolution.

use std::f64::consts::{PI, TAU};
use std::path::Path;

use super::{
    BALL_TRIANGLES, BALL_VERTICES, CLOTH_TRIANGLES, CLOTH_VERTICES, Diagonals, Mesh, TORUS_TRIANGLES, TORUS_VERTICES,
    cuboid, grid, icosphere, ragged_slivers, twisted_rod,
};
use crate::random::Random;
use crate::recording::{Recording, RecordingError};

/// One body of a [`MovingScene`].
#[derive(Clone, Debug)]
pub struct MovingBody {
    /// Its triangles.
    pub triangles: Vec<[u32; 3]>,
    /// Its vertices in each tick.
    pub ticks: Vec<Vec<[f32; 3]>>,
    /// Whether it is closed and wound outward, so that it has an inside.
    pub is_closed: bool,
    /// Whether it may touch itself.
    pub touches_itself: bool,
}

/// Bodies that move together.
#[derive(Clone, Debug)]
pub struct MovingScene {
    /// Its name, in lower case with underscores.
    pub name: &'static str,
    /// A short description.
    pub what: &'static str,
    /// Whether its triangles deform.
    pub deforms: bool,
    /// The bodies, all with the same number of ticks.
    pub bodies: Vec<MovingBody>,
}

/// Mesh resolution of a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Fineness {
    /// Hundreds of triangles.
    Coarse,
    /// A few thousand triangles.
    Middle,
    /// Up to twenty thousand triangles.
    Fine,
}

impl Fineness {
    fn pick<T>(self, coarse: T, middle: T, fine: T) -> T {
        match self {
            Self::Coarse => coarse,
            Self::Middle => middle,
            Self::Fine => fine,
        }
    }
}

type Point = [f64; 3];

/// The names of all scenes that [`moving_scene`] accepts.
pub const MOVING_SCENES: [&str; 8] = [
    "cloth_over_ball",
    "twisted_rod",
    "soft_spheres",
    "box_on_edge_and_corner",
    "ten_sheets",
    "ribbed_panel",
    "mixed_sizes",
    "ragged_slivers",
];

/// The scene with that name in `ticks` ticks, or `None` if there is none.
///
/// `cloth_over_ball` is cut from `cloth_fall`, the bytes of the recording of [`super::cloth_fall`], whatever the
/// fineness.
///
/// # Errors
///
/// If `cloth_fall` is not that recording.
///
/// # Panics
///
/// If `ticks` is 0.
pub fn moving_scene(
    name: &str,
    fineness: Fineness,
    ticks: usize,
    cloth_fall: &[u8],
) -> Result<Option<MovingScene>, RecordingError> {
    assert!(ticks > 0, "a scene needs at least 1 tick");
    Ok(Some(match name {
        "cloth_over_ball" => cloth_over_ball(&Recording::from_bytes(cloth_fall, Path::new("cloth_fall"))?, ticks),
        "twisted_rod" => twisted_rods(fineness, ticks),
        "soft_spheres" => soft_spheres(fineness, ticks),
        "box_on_edge_and_corner" => tilted_boxes(fineness, ticks),
        "ten_sheets" => ten_sheets(fineness, ticks),
        "ribbed_panel" => ribbed_panel(fineness, ticks),
        "mixed_sizes" => mixed_sizes(fineness, ticks),
        "ragged_slivers" => sliver_sheets(fineness, ticks),
        _ => return Ok(None),
    }))
}

/// Two sheets of about `triangles` triangles in total that undulate above each other. The scene looks the same
/// everywhere, so the share of touching triangles does not depend on their number.
///
/// # Panics
///
/// If `ticks` is 0.
pub fn growing_sheets(triangles: usize, ticks: usize) -> MovingScene {
    assert!(ticks > 0, "a scene needs at least 1 tick");
    let cells = ((triangles as f64 / 4.0).sqrt().round() as usize).max(2);
    let sheet = grid(cells, cells, cells as f32, cells as f32, Diagonals::Alternating);
    // A cell is one unit long. The wave is far longer than a cell and as high as two cells.
    let height =
        |x: f64, z: f64, moment: f64| 2.0 * libm::sin(TAU * (x / 31.0 + 0.1 * moment)) * libm::cos(TAU * z / 37.0);
    let gap = |x: f64, z: f64, moment: f64| {
        0.4 + 0.5 * libm::sin(TAU * (x / 13.0 - 0.2 * moment)) * libm::sin(TAU * z / 17.0)
    };
    let lower = body(sheet.clone(), ticks, false, false, |[x, _, z], moment| [x, height(x, z, moment), z]);
    // Vertices of the upper sheet are above the interiors of the lower sheet's triangles.
    let upper = body(sheet, ticks, false, false, |[x, _, z], moment| {
        let (x, z) = (x + 0.31, z + 0.17);
        [x, height(x, z, moment) + gap(x, z, moment), z]
    });
    MovingScene {
        name: "growing_sheets",
        what: "two undulating sheets, the same picture at any number of triangles",
        deforms: true,
        bodies: vec![lower, upper],
    }
}

/// A body whose vertices are a function of their rest position and a moment from 0 to 1.
pub(super) fn body(
    mesh: Mesh,
    ticks: usize,
    is_closed: bool,
    touches_itself: bool,
    place: impl Fn(Point, f64) -> Point,
) -> MovingBody {
    let moment = |tick: usize| if ticks > 1 { tick as f64 / (ticks - 1) as f64 } else { 1.0 };
    let at = |tick: usize| -> Vec<[f32; 3]> {
        let moment = moment(tick);
        mesh.positions.iter().map(|rest| place(rest.map(f64::from), moment).map(|value| value as f32)).collect()
    };
    MovingBody { ticks: (0..ticks).map(at).collect(), triangles: mesh.triangles, is_closed, touches_itself }
}

/// The end of the embedded recording, every other frame, split into its three bodies.
fn cloth_over_ball(recording: &Recording, ticks: usize) -> MovingScene {
    let last = recording.frames.len() - 1;
    let frame = |tick: usize| last.saturating_sub(2 * (ticks - 1 - tick));
    let part = |vertices: std::ops::Range<usize>, triangles: std::ops::Range<usize>, is_closed: bool| MovingBody {
        triangles: recording.triangles[triangles]
            .iter()
            .map(|corners| corners.map(|corner| corner - vertices.start as u32))
            .collect(),
        ticks: (0..ticks).map(|tick| recording.frames[frame(tick)][vertices.clone()].to_vec()).collect(),
        is_closed,
        touches_itself: !is_closed,
    };
    MovingScene {
        name: "cloth_over_ball",
        what: "a cloth falls over a ball and a bending ring and folds onto itself",
        deforms: true,
        bodies: vec![
            part(CLOTH_VERTICES, CLOTH_TRIANGLES, false),
            part(BALL_VERTICES, BALL_TRIANGLES, true),
            part(TORUS_VERTICES, TORUS_TRIANGLES, true),
        ],
    }
}

/// Two square rods side by side, wrung around each other like the strands of a rope while the whole rotates.
fn twisted_rods(fineness: Fineness, ticks: usize) -> MovingScene {
    let across = fineness.pick(3, 6, 10);
    let (length, side) = (4.0, 0.4);
    let cell = side / across as f64;
    let along = (length / cell).round() as usize;
    let strand = |end: f64| {
        let rest = twisted_rod(length as f32, side as f32, along, across, 0.0);
        body(rest, ticks, true, false, move |[x, y, z], moment| {
            // The gap between the strands: slightly negative in some places, up to most of a cell in others.
            let gap = cell * (0.25 + 0.35 * libm::sin(3.0 * z + 2.0 * moment));
            let out = end * (x + 0.5 * (side + gap));
            let across = end * y;
            let angle = 0.8 * PI * moment + 1.4 * TAU * moment * z / length;
            let (sine, cosine) = (libm::sin(angle), libm::cos(angle));
            [out * cosine - across * sine, out * sine + across * cosine, z]
        })
    };
    MovingScene {
        name: "twisted_rod",
        what: "two square rods wrung around each other by 1.4 turns while they rotate",
        deforms: true,
        bodies: vec![strand(1.0), strand(-1.0)],
    }
}

/// Two soft balls that press into each other, flatten, and wobble.
fn soft_spheres(fineness: Fineness, ticks: usize) -> MovingScene {
    let level = fineness.pick(2, 3, 4);
    let ball = |end: f64| {
        body(icosphere(level, 1.0), ticks, true, false, move |[x, y, z], moment| {
            let squeeze = 1.0 - 0.3 * moment;
            // Nearly constant volume: the loss in length is gained in width.
            let widen = 1.0 / squeeze.sqrt();
            let wobble = 1.0 + 0.06 * moment * libm::sin(4.0 * y + TAU * moment) * libm::cos(3.0 * z + end);
            // The boxes overlap from the start, so that all spheres are made in the first tick.
            let distance = 0.99 - 0.39 * moment;
            [end * distance + squeeze * wobble * x, widen * wobble * y, widen * wobble * z + 0.05 * end]
        })
    };
    MovingScene {
        name: "soft_spheres",
        what: "two balls approach, flatten, wobble and penetrate each other",
        deforms: true,
        bodies: vec![ball(-1.0), ball(1.0)],
    }
}

/// A box on its edge and a box on its corner sink into a plane.
fn tilted_boxes(fineness: Fineness, ticks: usize) -> MovingScene {
    let cells = fineness.pick(4, 8, 16);
    let edge = 1.0 / cells as f64;
    let plane_cells = 4 * cells;
    let plane = grid(plane_cells, plane_cells, 4.6, 4.6, Diagonals::Alternating);
    let plane = body(plane, ticks, false, false, |rest, _| rest);
    let quarter = (PI / 4.0) as f32;
    // The space diagonal of a cube is at an angle of arccos(1/√3) from a face's normal.
    let corner = libm::acos(1.0 / 3.0_f64.sqrt()) as f32;
    let on_edge = cuboid([0.5; 3], cells).rotate([1.0, 0.0, 0.0], quarter);
    let on_corner = cuboid([0.5; 3], cells).rotate([0.0, 1.0, 0.0], quarter).rotate([0.0, 0.0, 1.0], corner);
    let lowered = move |mesh: Mesh, at: Point| {
        let lowest = mesh.positions.iter().map(|position| f64::from(position[1])).fold(f64::INFINITY, f64::min);
        body(mesh, ticks, true, false, move |[x, y, z], moment| {
            let height = edge * (0.6 - 0.9 * moment);
            [x + at[0] + 0.2 * edge * moment, y - lowest + height, z + at[2]]
        })
    };
    MovingScene {
        name: "box_on_edge_and_corner",
        what: "a box on its edge and a box on its corner sink into a plane",
        deforms: false,
        bodies: vec![plane, lowered(on_edge, [-1.03, 0.0, 0.02]), lowered(on_corner, [1.04, 0.0, -0.03])],
    }
}

/// Ten sheets above each other, each undulating slightly differently.
fn ten_sheets(fineness: Fineness, ticks: usize) -> MovingScene {
    let cells = fineness.pick(8, 18, 30);
    let edge = 1.0 / cells as f64;
    let layer = |layer: u32| {
        let mut random = Random::new(u64::from(layer) + 1);
        let [shift_x, shift_z] = [0; 2].map(|_| 0.5 * edge * f64::from(random.signed_unit()));
        let layer = f64::from(layer);
        body(grid(cells, cells, 1.0, 1.0, Diagonals::Alternating), ticks, false, true, move |[x, _, z], moment| {
            let wave = 0.05 * libm::sin(TAU * (1.3 * x + 0.4 * moment)) * libm::sin(TAU * (0.9 * z - 0.3 * moment));
            let ripple = 0.12 * edge * libm::sin(TAU * (2.0 * x + 1.7 * z + 0.37 * layer + 0.5 * moment));
            [x + shift_x, layer * 0.25 * edge + wave + ripple, z + shift_z]
        })
    };
    MovingScene {
        name: "ten_sheets",
        what: "ten undulating sheets stacked a quarter of a cell apart",
        deforms: true,
        bodies: (0..10).map(layer).collect(),
    }
}

/// A closed panel with ribs, thinner than its cells, that bends, and a bar that lies across its ribs.
fn ribbed_panel(fineness: Fineness, ticks: usize) -> MovingScene {
    let cells = fineness.pick(16, 32, 56);
    let edge = 2.0 / cells as f64;
    // Two layers of one box lattice: the upper and the lower side, joined by the rim.
    let panel = cuboid([1.0, 1.0, 1.0], cells);
    let rib = |x: f64| {
        // Trapezoids: four ribs with a height of three cells.
        let phase = (2.0 * (x + 1.0)) % 1.0;
        let ramp = |from: f64| ((phase - from) / 0.15).clamp(0.0, 1.0);
        3.0 * edge * (ramp(0.25) - ramp(0.6))
    };
    let panel = flatten(panel);
    let panel = body(panel, ticks, true, true, move |[x, y, z], moment| {
        let bend = 0.15 * moment * (x * x - 0.3 * z * z);
        [x, rib(x) + y * 0.17 * edge + bend, z]
    });
    let bar_cells = [cells * 3 / 4, 3];
    let bar = twisted_rod(1.5, 3.0 * edge as f32, bar_cells[0], bar_cells[1], 0.0);
    let bar = body(bar, ticks, true, false, move |[x, y, z], moment| {
        // Rotated to lie along x, across the ribs.
        let (x, z) = (z, -x);
        let bend = 0.15 * moment * x * x;
        [x, y + 1.5 * edge + 3.0 * edge + edge * (0.22 - 0.37 * moment) + bend, z + 0.21 * edge]
    });
    MovingScene {
        name: "ribbed_panel",
        what: "a closed panel with ribs, its walls a third of a cell apart, bends under a bar",
        deforms: true,
        bodies: vec![panel, bar],
    }
}

/// The surface of a cube without the inner rows of cells of its four upright sides. Each side becomes one row of cells,
/// so that the cube can be flattened to a plate.
fn flatten(cube: Mesh) -> Mesh {
    let on_rim = |position: &[f32; 3]| position[0].abs() == 1.0 || position[2].abs() == 1.0;
    let is_cap = |position: &[f32; 3]| position[1].abs() == 1.0;
    // Vertices between the two caps move to the nearer cap and coincide with the rim. Their triangles vanish or span
    // the gap.
    let mut places = std::collections::BTreeMap::new();
    let mut flat = Mesh::default();
    let number: Vec<u32> = cube
        .positions
        .iter()
        .map(|position| {
            let mut moved = *position;
            if on_rim(position) && !is_cap(position) {
                moved[1] = if position[1] >= 0.0 { 1.0 } else { -1.0 };
            }
            *places.entry(moved.map(f32::to_bits)).or_insert_with(|| {
                flat.positions.push(moved);
                flat.positions.len() as u32 - 1
            })
        })
        .collect();
    flat.triangles = cube
        .triangles
        .iter()
        .map(|corners| corners.map(|corner| number[corner as usize]))
        .filter(|[a, b, c]| a != b && b != c && c != a)
        .collect();
    flat
}

/// Small balls roll over ground whose triangles are a thousand times as long as theirs, and past a block of medium
/// size.
fn mixed_sizes(fineness: Fineness, ticks: usize) -> MovingScene {
    let level = fineness.pick(1, 2, 3);
    let mut bodies = vec![body(grid(3, 3, 300.0, 300.0, Diagonals::Alternating), ticks, false, false, |rest, _| rest)];
    // Edges of a ball of radius 1 are about 1.1 long, and halve at each level.
    let edge = 0.1;
    let radius = edge * f64::from(1_u32 << level) / 1.1;
    // Some places are above inner edges and corners of the ground, which are at ±50.
    let places = [[50.0, 50.0], [-50.0, 3.0], [10.0, -50.0], [20.0, 20.0], [-50.0, -50.0], [0.05, 0.02]];
    for (number, [x, z]) in places.into_iter().enumerate() {
        let number = number as f64;
        bodies.push(body(icosphere(level, 1.0), ticks, true, false, move |position, moment| {
            let angle = 1.3 * moment + number;
            let (sine, cosine) = (libm::sin(angle), libm::cos(angle));
            let [a, b, c] = position;
            let depth = edge * (0.45 - 0.13 * number);
            let rolled = radius * 0.6 * moment;
            [
                x + radius * (a * cosine + b * sine) + rolled,
                radius * (1.0 + b * cosine - a * sine) + depth,
                z + radius * c,
            ]
        }));
    }
    let block = cuboid([2.0, 0.5, 2.0], fineness.pick(2, 4, 6));
    // The last ball rolls up to the block and into it by a fifth of an edge.
    let face = 0.05 + 1.6 * radius - 0.2 * edge;
    bodies.push(body(block, ticks, true, false, move |[x, y, z], _| [x + 2.0 + face, y + 0.5 + 0.05 * edge, z]));
    MovingScene {
        name: "mixed_sizes",
        what: "balls roll over a ground and by a block, edges of 0.1, 1 and 100 beside each other",
        deforms: false,
        bodies,
    }
}

/// Crumpled sheets with slivers and zero-area triangles slide over each other.
fn sliver_sheets(fineness: Fineness, ticks: usize) -> MovingScene {
    let layer = |layer: u32| {
        let number = f64::from(layer);
        body(ragged_slivers(u64::from(layer) + 7), ticks, false, true, move |[x, y, z], moment| {
            let slide = 0.05 * moment * (number - 1.5);
            [x + slide, y + 0.012 * number + 0.01 * libm::sin(5.0 * x + 3.0 * moment), z + 0.4 * slide]
        })
    };
    MovingScene {
        name: "ragged_slivers",
        what: "crumpled sheets with slivers and triangles without area slide over each other",
        deforms: true,
        bodies: (0..fineness.pick(2, 3, 6)).map(layer).collect(),
    }
}
