//! The line of figures, and the keys that switch what is drawn over the game.

use std::time::{Duration, Instant};

use bevy::prelude::*;
use bevy_circumsphere::{
    ContactStore,
    debug::{DeformableGizmos, LevelOfDetail},
    detection::DetectionDiagnostics,
    prelude::*,
    response::{XpbdDiagnostics, XpbdGarment},
};

use crate::{Options, balls::Throw, game::Ready};

/// Time over which figures are averaged.
const WINDOW: Duration = Duration::from_millis(500);

/// The keys, and the layers that they switch.
const KEYS: [(KeyCode, char, &str); 5] = [
    (KeyCode::Digit1, '1', "contacts"),
    (KeyCode::Digit2, '2', "wires"),
    (KeyCode::Digit3, '3', "spheres"),
    (KeyCode::Digit4, '4', "shapes"),
    (KeyCode::Digit5, '5', "trees"),
];

/// Levels of the trees that are drawn.
const LEVELS: u32 = 6;

/// Which layers are drawn, in the order of [`KEYS`].
#[derive(Resource, Clone, Debug, PartialEq)]
struct Layers([bool; KEYS.len()]);

#[derive(Component)]
struct Figures;

/// What has happened since the figures were last written.
#[derive(Default)]
struct Sums {
    ticks: u32,
    contacts: usize,
    detection: Duration,
    response: Duration,
    /// Not of `Time<Real>`, whose clock may be the game's.
    since: Option<Instant>,
}

pub fn plugin(options: &Options) -> impl Fn(&mut App) + Send + Sync + 'static {
    let layers = Layers(KEYS.map(|(_, digit, _)| options.layers.contains(digit)));
    let is_shown = !options.no_text;
    move |app| {
        app.insert_resource(layers.clone())
            .add_systems(Startup, move |commands: Commands| spawn(commands, is_shown))
            .add_systems(Update, (press, choose.run_if(resource_changed::<Layers>)).chain())
            .add_systems(Update, measure.run_if(|ready: Res<Ready>| ready.0));
    }
}

fn spawn(mut commands: Commands, is_shown: bool) {
    let keys: Vec<String> = KEYS.iter().map(|(_, digit, layer)| format!("{digit} {layer}")).collect();
    let keys = format!("{}   T throw   H hide   W A S D E Q and right mouse button: fly", keys.join("   "));
    let text = |text: String, size: f32| (Text::new(text), TextFont::from_font_size(size), TextColor(Color::WHITE));
    commands.spawn((
        Node {
            position_type: PositionType::Absolute,
            flex_direction: FlexDirection::Column,
            row_gap: px(2),
            left: px(14),
            top: px(12),
            padding: UiRect::axes(px(12), px(8)),
            ..default()
        },
        BackgroundColor(Color::srgba(0.04, 0.06, 0.08, 0.55)),
        if is_shown { Visibility::Inherited } else { Visibility::Hidden },
        children![(Figures, text(String::new(), 19.0)), text(keys, 13.0)],
    ));
}

fn press(
    keys: Res<ButtonInput<KeyCode>>,
    mut layers: ResMut<Layers>,
    mut throws: MessageWriter<Throw>,
    mut panels: Query<&mut Visibility, With<Children>>,
    figures: Query<&ChildOf, With<Figures>>,
) {
    for (place, (key, ..)) in KEYS.iter().enumerate() {
        if keys.just_pressed(*key) {
            layers.0[place] ^= true;
        }
    }
    if keys.just_pressed(KeyCode::KeyT) {
        throws.write(Throw);
    }
    if keys.just_pressed(KeyCode::KeyH) {
        for panel in &figures {
            if let Ok(mut panel) = panels.get_mut(panel.parent()) {
                *panel = if *panel == Visibility::Hidden { Visibility::Inherited } else { Visibility::Hidden };
            }
        }
    }
}

/// Draws the layers that are switched on.
fn choose(
    mut commands: Commands,
    layers: Res<Layers>,
    mut store: ResMut<GizmoConfigStore>,
    garments: Query<Entity, With<XpbdGarment>>,
) {
    let [contacts, wires, spheres, shapes, trees] = layers.0;
    let (config, drawn) = store.config_mut::<DeformableGizmos>();
    config.enabled = layers.0.contains(&true);
    config.depth_bias = -0.02;
    let detail = |is_on: bool| if is_on { LevelOfDetail::All } else { LevelOfDetail::Off };
    *drawn = DeformableGizmos {
        contacts,
        penetrations: contacts,
        meshes: detail(wires),
        spheres: detail(spheres),
        shapes,
        tree_levels: if trees { LEVELS } else { 0 },
        patches: LevelOfDetail::Off,
        ..default()
    };
    // Only this method has spheres.
    let method = if spheres { ContactMethod::Circumsphere } else { ContactMethod::Exact };
    for garment in &garments {
        commands.entity(garment).insert(method);
    }
}

fn measure(
    mut sums: Local<Sums>,
    mut figures: Query<&mut Text, With<Figures>>,
    store: Res<ContactStore>,
    detection: Res<DetectionDiagnostics>,
    response: Res<XpbdDiagnostics>,
) {
    sums.ticks += 1;
    sums.contacts += store.contact_count();
    sums.detection += detection.total();
    sums.response += response.gathering + response.solving + response.guarding;
    let now = Instant::now();
    let since = now - *sums.since.get_or_insert(now);
    if since < WINDOW {
        return;
    }
    let each = |time: Duration| 1.0e3 * time.as_secs_f64() / f64::from(sums.ticks);
    for mut text in &mut figures {
        text.0 = format!(
            "{:.0} ticks a second   {} contacts   detection {:.1} ms   response {:.1} ms",
            f64::from(sums.ticks) / since.as_secs_f64(),
            sums.contacts / sums.ticks as usize,
            each(sums.detection),
            each(sums.response),
        );
    }
    *sums = Sums { since: Some(now), ..default() };
}
