//! Thin-walled panels with a known middle surface: a plate with ribs on one side or both, flat or bent, with holes, and
//! of even or varying thickness.

use std::f64::consts::FRAC_PI_2;

use super::{Mesh, tray::boundary};

/// A plate with ribs, as one closed solid. Lengths are in any unit.
///
/// The middle of the plate is the plane y = 0, and the origin is its center. The middles of ribs are planes of constant x
/// or z, evenly spaced. A bent panel is rolled around an axis along z, at x = 0 and y = −`radius`: angles are
/// x / `radius`, and lengths along y stay as they are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Panel {
    /// The lengths along x and z.
    pub size: [f32; 2],
    /// The thickness of the plate where x is least.
    pub thickness: f32,
    /// The thickness where x is greatest, as a multiple of the least. It varies linearly.
    pub taper: f32,
    /// The numbers of ribs of constant x and of constant z. Where they cross, they form an X.
    pub ribs: [usize; 2],
    /// The height of the ribs above the plate's middle.
    pub rib_height: f32,
    /// The thickness of the ribs.
    pub rib_thickness: f32,
    /// Whether there are ribs on the lower side, too, opposite the upper ones.
    pub both_sides: bool,
    /// Whether each field between ribs has a square hole of a third of its size.
    pub holes: bool,
    /// The radius to which the plate's middle is bent.
    pub radius: Option<f32>,
    /// The longest side of a square of two triangles.
    pub longest_side: f32,
}

impl Default for Panel {
    /// A flat plate, 0.6 by 0.4 and 0.006 thick.
    fn default() -> Self {
        Self {
            size: [0.6, 0.4],
            thickness: 0.006,
            taper: 1.0,
            ribs: [0, 0],
            rib_height: 0.04,
            rib_thickness: 0.004,
            both_sides: false,
            holes: false,
            radius: None,
            longest_side: 0.05,
        }
    }
}

/// The lines of a lattice along one axis, and what is between them.
struct Lines {
    at: Vec<f64>,
    is_rib: Vec<bool>,
    is_hole: Vec<bool>,
}

impl Panel {
    /// The panel with two ribs one way, one the other way, and holes: what the example shows without a file.
    #[must_use]
    pub fn ribbed() -> Self {
        Self { ribs: [2, 1], holes: true, ..Self::default() }
    }

    /// The coordinates of the middles of the ribs of constant x, or of constant z.
    #[must_use]
    pub fn rib_middles(&self, axis: usize) -> Vec<f64> {
        let (count, size) = (self.ribs[axis], f64::from(self.size[axis]));
        (1..=count).map(|rib| size * (rib as f64 / (count + 1) as f64 - 0.5)).collect()
    }

    /// The thickness of the plate at x, before it is bent.
    #[must_use]
    pub fn thickness_at(&self, x: f64) -> f64 {
        let along = x / f64::from(self.size[0]) + 0.5;
        f64::from(self.thickness) * (1.0 + (f64::from(self.taper) - 1.0) * along)
    }

    fn lines(&self, axis: usize) -> Lines {
        let half = 0.5 * f64::from(self.size[axis]);
        let rib = 0.5 * f64::from(self.rib_thickness);
        let middles = self.rib_middles(axis);
        let starts = std::iter::once(-half).chain(middles.iter().map(|middle| middle + rib));
        let ends = middles.iter().map(|middle| middle - rib).chain([half]);
        let mut lines = Lines { at: vec![-half], is_rib: Vec::new(), is_hole: Vec::new() };
        for (field, (start, end)) in starts.zip(ends).enumerate() {
            if field > 0 {
                lines.extend(start, 1, [true, false]);
            }
            let thirds = [start, start + (end - start) / 3.0, end - (end - start) / 3.0, end];
            for third in 0..3 {
                let length = thirds[third + 1] - thirds[third];
                let parts = (length / f64::from(self.longest_side)).ceil().max(1.0) as usize;
                lines.extend(thirds[third + 1], parts, [false, third == 1]);
            }
        }
        lines
    }
}

impl Lines {
    /// Goes on to `end` in `parts` steps.
    fn extend(&mut self, end: f64, parts: usize, [is_rib, is_hole]: [bool; 2]) {
        let start = self.at[self.at.len() - 1];
        for part in 1..=parts {
            self.at.push(start + (end - start) * (part as f64 / parts as f64));
            self.is_rib.push(is_rib);
            self.is_hole.push(is_hole);
        }
    }
}

/// A panel as a closed solid, wound outward.
///
/// # Panics
///
/// If a size is not positive, if ribs have no room or are not higher than the plate, or if a bent panel would close to
/// more than half a turn.
pub fn panel(panel: &Panel) -> Mesh {
    let [width, depth] = panel.size;
    let thickest = panel.thickness * panel.taper.max(1.0);
    let positive = [width, depth, panel.thickness, panel.taper, panel.rib_thickness, panel.longest_side];
    assert!(positive.iter().all(|&size| size > 0.0), "sizes are positive");
    let has_room = (0..2).all(|axis| panel.ribs[axis] as f32 * panel.rib_thickness < 0.5 * panel.size[axis]);
    assert!(has_room, "the ribs need more room");
    assert!(panel.ribs == [0, 0] || panel.rib_height > thickest, "the ribs must be higher than the plate");
    assert!(
        panel.radius.is_none_or(|radius| f64::from(width / radius) <= 2.0 * FRAC_PI_2),
        "a panel is bent by no more than half a turn"
    );
    let (columns, rows) = (panel.lines(0), panel.lines(1));
    // From below: ribs, plate, ribs.
    let rib_parts = (panel.rib_height / panel.longest_side).ceil().max(1.0) as usize;
    let below = if panel.both_sides { rib_parts } else { 0 };
    let above = if panel.ribs == [0, 0] { 0 } else { rib_parts };
    let layers = below + 1 + above;
    let is_filled = |[column, layer, row]: [usize; 3]| {
        let is_plate = layer == below;
        let is_hole = panel.holes && columns.is_hole[column] && rows.is_hole[row];
        if is_plate { !is_hole } else { columns.is_rib[column] || rows.is_rib[row] }
    };
    let place = |[column, layer, row]: [usize; 3]| {
        let (x, z) = (columns.at[column], rows.at[row]);
        let surface = 0.5 * panel.thickness_at(x);
        let height = f64::from(panel.rib_height);
        let y = if layer > below {
            surface + (height - surface) * (layer - below - 1) as f64 / rib_parts as f64
        } else {
            -surface - (height - surface) * (below - layer) as f64 / rib_parts as f64
        };
        let [x, y] = match panel.radius.map(f64::from) {
            Some(radius) => {
                let (sine, cosine) = (libm::sin(x / radius), libm::cos(x / radius));
                [(radius + y) * sine, (radius + y) * cosine - radius]
            }
            None => [x, y],
        };
        [x, y, z].map(|coordinate| coordinate as f32)
    };
    boundary([columns.at.len() - 1, layers, rows.at.len() - 1], is_filled, place)
}
