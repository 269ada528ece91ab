//! Panels whose middle surface is known.

use bevy_circumsphere::geometry::thin_wall::RegionKind;
use circumsphere_support::scenes::{Panel, panel};
use glam::DVec3;

use super::{borders, find, sheet};

/// The share of the area that must become sheets. The ends of crossing ribs are part of it.
const LEAST_SHARE: f64 = 0.95;

/// The largest Hausdorff distance, in thicknesses.
const MOST_DEVIATION: f64 = 0.05;

/// Coordinates of up to 0.6 in f32, after some additions, in lengths.
const ROUNDING: f64 = 1e-6;

/// A point of a bent panel, unrolled.
fn unrolled(panel: &Panel, point: DVec3) -> DVec3 {
    let Some(radius) = panel.radius.map(f64::from) else { return point };
    let upward = point.y + radius;
    DVec3::new(radius * libm::atan2(point.x, upward), point.x.hypot(upward) - radius, point.z)
}

/// The distance of an unrolled point from the middle of the nearest rib, and half the thickness of ribs.
fn from_ribs(panel: &Panel, point: DVec3) -> f64 {
    let nearest = |axis: usize, at: f64| {
        panel.rib_middles(axis).iter().map(|middle| (at - middle).abs()).fold(f64::INFINITY, f64::min)
    };
    nearest(0, point.x).min(nearest(1, point.z))
}

/// Checks a panel against its true middle surface. Vertices may be off by `tolerance` thicknesses: flat facets stand for
/// a bent panel.
fn check(name: &str, of: Panel, tolerance: f64) {
    let mesh = panel(&of);
    let (walls, deviation) = find(&mesh);
    let share = walls.abstracted_area / walls.area_before;
    let kept = walls.triangles.len() as f64 / mesh.triangles.len() as f64;
    println!("{name}: {share:.4} of the area, {kept:.3} of the triangles, {:.4} thicknesses", deviation.over_thickness);
    assert!(share >= LEAST_SHARE, "{name}: only {share} of the area is replaced: {:?}", walls.left_out);
    assert!(walls.abstracted_area >= LEAST_SHARE * walls.thin_area, "{name}");
    assert!(kept <= 0.5, "{name}: {kept} of the triangles are left");
    assert!(deviation.over_thickness <= MOST_DEVIATION, "{name}: {deviation:?}");

    let off = tolerance * f64::from(of.thickness) + ROUNDING;
    let rib_half = 0.5 * f64::from(of.rib_thickness);
    for (triangle, corners) in sheet(&walls).iter().enumerate() {
        let points = corners.map(|corner| unrolled(&of, walls.positions[corner as usize].as_dvec3()));
        let is_plate = points.iter().all(|point| point.y.abs() <= off);
        let is_rib = points.iter().all(|&point| from_ribs(&of, point) <= off);
        assert!(is_plate || is_rib, "{name}: triangle {triangle} is in no middle surface: {points:?}");
        for (&corner, point) in corners.iter().zip(points) {
            let half = f64::from(walls.half_thickness[corner as usize]);
            let expected = if is_plate { 0.5 * of.thickness_at(point.x) } else { rib_half };
            // On a slope, half the thickness across the plate is that along y, times a cosine of nearly 1.
            assert!((half - expected).abs() <= 2.0 * off, "{name}: {half} instead of {expected} at {point}");
        }
    }

    // Sheets end only where the panel does: at its outline, at holes, and at the tops of ribs.
    let [width, depth] = of.size.map(|size| 0.5 * f64::from(size));
    let is_hole = |at: f64, axis: usize| {
        let rib = 0.5 * f64::from(of.rib_thickness);
        let middles = of.rib_middles(axis);
        let half = 0.5 * f64::from(of.size[axis]);
        let starts = std::iter::once(-half).chain(middles.iter().map(|middle| middle + rib));
        let ends = middles.iter().map(|middle| middle - rib).chain([half]);
        starts.zip(ends).any(|(start, end)| {
            let third = (end - start) / 3.0;
            at >= start + third - off && at <= end - third + off
        })
    };
    for middle in borders(&walls) {
        let point = unrolled(&of, middle);
        let at_outline = (point.x.abs() - width).abs() <= off || (point.z.abs() - depth).abs() <= off;
        let at_top = (point.y.abs() - f64::from(of.rib_height)).abs() <= off;
        let at_hole = of.holes && point.y.abs() <= off && is_hole(point.x, 0) && is_hole(point.z, 1);
        assert!(at_outline || at_top || at_hole, "{name}: a sheet ends at {point}");
    }
}

#[test]
fn flat_panels_are_sheets_in_their_middle() {
    check("flat", Panel::default(), 1e-3);
    check("flat, two triangles a side", Panel { longest_side: 10.0, ..Panel::default() }, 1e-3);
    check("with holes", Panel { holes: true, ..Panel::default() }, 1e-3);
}

#[test]
fn bent_panels_are_bent_sheets() {
    let bent = Panel { radius: Some(0.3), longest_side: 0.02, ..Panel::default() };
    check("bent", bent, 0.03);
    check("bent, with ribs", Panel { ribs: [2, 2], ..bent }, 0.03);
}

#[test]
fn a_wall_that_is_as_thick_everywhere_has_one_thickness() {
    let bent = Panel { radius: Some(0.3), longest_side: 0.02, ..Panel::default() };
    let thicknesses = |of: &Panel| {
        let (walls, _) = find(&panel(of));
        let bits: std::collections::BTreeSet<u32> = walls.half_thickness.iter().map(|half| half.to_bits()).collect();
        bits.len()
    };
    assert_eq!(thicknesses(&bent), 1);
    // Feet of ribs have the thickness of the rib, or of the plate, and none in between.
    assert!(thicknesses(&Panel { ribs: [2, 0], ..Panel::default() }) <= 3);
    assert!(thicknesses(&Panel { taper: 3.0, ..Panel::default() }) > 5);
}

#[test]
fn ribs_join_their_plate_and_each_other() {
    check("T", Panel { ribs: [2, 0], ..Panel::default() }, 1e-3);
    check("T, coarse", Panel { ribs: [2, 0], longest_side: 10.0, ..Panel::default() }, 1e-3);
    check("X of ribs", Panel { ribs: [2, 2], ..Panel::default() }, 1e-3);
    check("X of ribs and plate", Panel { ribs: [2, 1], both_sides: true, ..Panel::default() }, 1e-3);
    check("X with holes", Panel::ribbed(), 1e-3);
}

#[test]
fn thickness_may_vary_threefold() {
    let tapered = Panel { taper: 3.0, ..Panel::default() };
    check("tapered", tapered, 2e-3);
    check("tapered, with ribs and holes", Panel { ribs: [2, 1], holes: true, ..tapered }, 2e-3);
}

#[test]
fn ribs_are_children_of_their_plate() {
    let (walls, _) = find(&panel(&Panel { ribs: [2, 0], ..Panel::default() }));
    let kinds: Vec<_> = walls.regions.iter().map(|region| (region.kind, region.parent)).collect();
    assert_eq!(kinds, [(RegionKind::Plate, None), (RegionKind::Rib, Some(0)), (RegionKind::Rib, Some(0))]);
    let plate = &walls.regions[0];
    // Closed forms: both sides and the outline, without the feet of the ribs.
    let expected = 0.6 * 0.4 * 2.0 - 2.0 * 0.4 * 0.004 + 2.0 * (0.6 + 0.4) * 0.006;
    assert!((plate.area - expected).abs() < 0.01 * expected, "{} instead of {expected}", plate.area);
    for (region, thickness) in walls.regions.iter().zip([0.006, 0.004, 0.004]) {
        for found in [region.thickness_min, region.thickness_max] {
            assert!((found - thickness).abs() <= ROUNDING, "{found} instead of {thickness}");
        }
    }
}

#[test]
fn the_result_does_not_depend_on_scale() {
    let of = Panel::ribbed();
    let mesh = panel(&of);
    let (walls, deviation) = find(&mesh);
    for factor in [1.0 / 1024.0, 1024.0] {
        // Powers of two: the same mantissas.
        let (scaled, other) = find(&mesh.clone().scale(factor));
        assert_eq!(scaled.triangles, walls.triangles);
        let moved: Vec<_> = walls.positions.iter().map(|&position| position * factor).collect();
        assert_eq!(scaled.positions, moved);
        assert!((other.over_thickness - deviation.over_thickness).abs() < 1e-6);
    }
}
