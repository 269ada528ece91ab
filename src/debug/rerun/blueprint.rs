//! Layout of a recording in the viewer: the scene with the log beside it, and curves below both.
//!
//! The layout types of the SDK cannot hide an entity. So this module writes the rows of a layout itself, at the paths
//! that the viewer uses.

use glam::{BVec3, Vec3};
use rerun::{
    AsComponents, EntityPath, RecordingStream, RecordingStreamBuilder, RecordingStreamResult,
    external::{
        re_log_types::BlueprintActivationCommand,
        re_sdk_types::blueprint::{
            archetypes::{
                Background, ContainerBlueprint, EntityBehavior, EyeControls3D, LineGrid3D, PanelBlueprint, PlotLegend,
                TextLogColumns, TimePanelBlueprint, ViewBlueprint, ViewContents, ViewportBlueprint,
            },
            components::{
                BackgroundKind, ColumnShare, ContainerKind, Corner2D, IncludedContent, PanelState, PlayState,
                RootContainer, RowShare, TextLogColumn, TimelineColumn,
            },
            datatypes::{self, TextLogColumnKind},
        },
    },
};

use super::{
    TICK, colors,
    recorder::{Layer, path},
    series::{COUNTS, DEPTHS, MILLISECONDS, MOTION, SERIES, STEADINESS},
    text_log::LOG,
};
use crate::kernel::mesh::bounds::Aabb;

/// Layers that are initially hidden.
const HIDDEN: [Layer; 7] =
    [Layer::Pairs, Layer::Spheres, Layer::Cones, Layer::Curvature, Layer::RecipeAge, Layer::Tree, Layer::Cells];

/// A view or container, identified by the number in its identifier.
struct Part {
    path: EntityPath,
    identifier: [u8; 16],
}

impl Part {
    fn new(kind: &str, number: u8) -> Self {
        let mut identifier = *b"circumsphere\0\0\0\0";
        identifier[15] = number;
        let hex = format!("{:032x}", u128::from_be_bytes(identifier));
        let uuid = format!("{}-{}-{}-{}-{}", &hex[..8], &hex[8..12], &hex[12..16], &hex[16..20], &hex[20..]);
        Self { path: path([kind, &uuid]), identifier }
    }
}

/// Writes the parts of a layout.
struct Layout {
    stream: RecordingStream,
    parts: u8,
}

impl Layout {
    fn log(&self, path: EntityPath, archetype: &dyn AsComponents) -> RecordingStreamResult<()> {
        self.stream.log(path, archetype)
    }

    fn part(&mut self, kind: &str) -> Part {
        self.parts += 1;
        Part::new(kind, self.parts)
    }

    fn view(&mut self, class: &str, name: &str, origin: &str, contents: &[&str]) -> RecordingStreamResult<Part> {
        let view = self.part("view");
        let blueprint = ViewBlueprint::new(class).with_display_name(name).with_space_origin(origin);
        self.log(view.path.clone(), &blueprint)?;
        let contents = ViewContents::new(contents.iter().copied());
        self.log(view.path.join(&path(["ViewContents"])), &contents)?;
        Ok(view)
    }

    fn container(&mut self, kind: ContainerKind, children: &[(&Part, f32)]) -> RecordingStreamResult<Part> {
        let container = self.part("container");
        let contents = children.iter().map(|(child, _)| IncludedContent(child.path.to_string().into()));
        let blueprint = ContainerBlueprint::new(kind).with_contents(contents);
        let shares = children.iter().map(|&(_, share)| share);
        let blueprint = match kind {
            ContainerKind::Horizontal => blueprint.with_col_shares(shares.map(|share| ColumnShare(share.into()))),
            _ => blueprint.with_row_shares(shares.map(|share| RowShare(share.into()))),
        };
        self.log(container.path.clone(), &blueprint)?;
        Ok(container)
    }
}

/// Where the eye is, as seen from the center of the scene.
const EYE: Vec3 = Vec3::new(0.47, 0.33, 0.6);

/// Half of the height and width that the viewer shows at a distance of 1: its field of view is 55° high, and the view at
/// least one and a half times as wide as high in windows of usual shapes. A tenth is left free at the borders.
const SEEN: [f32; 2] = [0.9 * 0.5206, 0.9 * 1.5 * 0.5206];

/// Where the eye is to see all of these boxes, and what it looks at, as near as it can be. `None` if there is nothing to
/// see.
fn eye_on(boxes: &[Aabb]) -> Option<[Vec3; 2]> {
    let all = boxes.iter().fold(Aabb::EMPTY, |all, bounds| all.union(bounds));
    let size = (all.max - all.min).length();
    if !(size.is_finite() && size > 0.0) {
        return None;
    }
    let center = (all.min + all.max) * 0.5;
    let back = EYE.normalize();
    let right = Vec3::Y.cross(back).normalize();
    let up = back.cross(right);
    let corners = boxes.iter().flat_map(|Aabb { min, max }| {
        (0..8).map(|corner| Vec3::select(BVec3::new(corner & 1 == 0, corner & 2 == 0, corner & 4 == 0), *min, *max))
    });
    // How far back the eye must be to see a corner.
    let away = |corner: Vec3| {
        let corner = corner - center;
        corner.dot(back) + (corner.dot(up).abs() / SEEN[0]).max(corner.dot(right).abs() / SEEN[1])
    };
    Some([center + back * corners.map(away).fold(0.0, f32::max), center])
}

/// Sends the layout into a recording and activates it, with the eye on `boxes`.
pub(super) fn send(recording: &RecordingStream, boxes: &[Aabb]) -> RecordingStreamResult<()> {
    let Some(store) = recording.store_info() else { return Ok(()) };
    let builder = RecordingStreamBuilder::new(store.application_id().clone()).recording_id("layout").blueprint();
    let (stream, storage) = builder.memory()?;
    let Some(layout_info) = stream.store_info() else { return Ok(()) };
    stream.set_time_sequence("blueprint", 0);
    let mut layout = Layout { stream, parts: 0 };

    let scene =
        layout.view("3D", "scene", "/", &["$origin/**", &format!("- /{SERIES}/**"), &format!("- /{LOG}/**")])?;
    for layer in HIDDEN {
        let overrides = path(["ViewContents", "overrides", layer.name(), "visualizers"]);
        layout.log(scene.path.join(&overrides), &EntityBehavior::new().with_visible(false))?;
    }
    let of_scene = |property: &str| scene.path.join(&path([property]));
    layout.log(of_scene("Background"), &Background::new(BackgroundKind::SolidColor).with_color(colors::BACKGROUND))?;
    layout.log(of_scene("LineGrid3D"), &LineGrid3D::new().with_visible(false))?;
    // By default the viewer stays one unit away, however small the scene is.
    if let Some([position, target]) = eye_on(boxes) {
        let eye = EyeControls3D::new()
            .with_position(position.to_array())
            .with_look_target(target.to_array())
            .with_eye_up(Vec3::Y.to_array());
        layout.log(of_scene("EyeControls3D"), &eye)?;
    }
    let log = layout.view("TextLog", "log", &format!("/{LOG}"), &["$origin/**"])?;
    layout.log(log.path.join(&path(["TextLogColumns"])), &text_log_columns())?;
    let mut plot = |name: &str, part: &str| {
        let plot = layout.view("TimeSeries", name, &format!("/{SERIES}/{part}"), &["$origin/**"])?;
        layout.log(plot.path.join(&path(["PlotLegend"])), &PlotLegend::new().with_corner(Corner2D::LeftTop))?;
        RecordingStreamResult::Ok(plot)
    };
    let milliseconds = plot("milliseconds of each stage", MILLISECONDS)?;
    let counts = plot("pairs after each stage", COUNTS)?;
    let steadiness = plot("steadiness", STEADINESS)?;
    let motion = plot("motion in contact distances a tick", MOTION)?;
    let depths = plot("depths in world units", DEPTHS)?;
    let plots = layout.container(ContainerKind::Horizontal, &[(&milliseconds, 1.0), (&counts, 1.0)])?;
    let left = layout.container(ContainerKind::Vertical, &[(&scene, 2.0), (&plots, 1.0)])?;
    let right = layout
        .container(ContainerKind::Vertical, &[(&log, 1.0), (&steadiness, 1.0), (&motion, 1.0), (&depths, 1.0)])?;
    let root = layout.container(ContainerKind::Horizontal, &[(&left, 3.0), (&right, 1.0)])?;
    let viewport = ViewportBlueprint::new()
        .with_root_container(RootContainer(root.identifier.into()))
        .with_auto_layout(false)
        .with_auto_views(false);
    layout.log(path(["viewport"]), &viewport)?;
    layout.log(path(["time_panel"]), &time_panel())?;
    layout.log(path(["selection_panel"]), &PanelBlueprint::new().with_state(PanelState::Collapsed))?;

    let activation =
        BlueprintActivationCommand { blueprint_id: layout_info.store_id, make_active: true, make_default: true };
    recording.send_blueprint(storage.take(), activation);
    Ok(())
}

fn time_panel() -> TimePanelBlueprint {
    // Following: the recording opens at its last tick, where most has happened.
    TimePanelBlueprint::new()
        .with_state(PanelState::Collapsed)
        .with_timeline(TICK)
        .with_play_state(PlayState::Following)
}

/// The tick, level, and text. The path of the entity would take half of the width.
fn text_log_columns() -> TextLogColumns {
    let column = |kind| TextLogColumn(datatypes::TextLogColumn { visible: true.into(), kind });
    let timeline = datatypes::TimelineColumn { visible: true.into(), timeline: TICK.into() };
    TextLogColumns::new()
        .with_timeline_columns([TimelineColumn(timeline)])
        .with_text_log_columns([TextLogColumnKind::LogLevel, TextLogColumnKind::Body].map(column))
}
