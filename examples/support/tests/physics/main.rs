//! The bodies and motions of the physics scenes, compared with closed forms and with brute force in `f64`.

mod bodies;
mod character;
mod figure;
mod geometry;
mod instrument;
mod level;
mod pile;

use circumsphere_support::scenes::{
    Mesh, closed_target, cloth_layers, instrument, instrument_pose, needle, pelvis_offset, pile_body, pile_start,
    pile_tray, skirt, walking_figure,
};

/// Everything that a scene can request, at times in descending order, so that hidden state would show.
fn everything() -> (Vec<Mesh>, Vec<[f32; 7]>) {
    let mut meshes = vec![closed_target(), needle(0.2, 0.002), pile_tray(), instrument(), skirt(24, 64)];
    meshes.extend(cloth_layers(3, 8, 0.02, 0.01));
    meshes.extend((0..30).map(pile_body));
    let mut places = Vec::new();
    for tick in (0..40).rev() {
        let time = 0.11 * f64::from(tick);
        meshes.extend(walking_figure(time));
        let ([x, y, z], [i, j, k, w]) = instrument_pose(time);
        places.push([x, y, z, i, j, k, w]);
        let [x, y, z] = pelvis_offset(time);
        let [u, v, t] = pile_start(tick as usize);
        places.push([x, y, z, u, v, t, 0.0]);
    }
    (meshes, places)
}

/// Meshes are compared bitwise: zeros of different sign would give different recordings.
#[test]
fn everything_is_the_same_bits_in_every_call_and_thread() {
    let bits = |(meshes, places): (Vec<Mesh>, Vec<[f32; 7]>)| {
        let positions = meshes.iter().flat_map(|mesh| mesh.positions.iter().flatten().copied().collect::<Vec<f32>>());
        let coordinates: Vec<u32> = positions.chain(places.into_iter().flatten()).map(f32::to_bits).collect();
        let triangles: Vec<[u32; 3]> = meshes.iter().flat_map(|mesh| mesh.triangles.clone()).collect();
        (coordinates, triangles)
    };
    let here = bits(everything());
    let threads: Vec<_> = (0..2).map(|_| std::thread::spawn(everything)).collect();
    for thread in threads {
        assert!(bits(thread.join().unwrap()) == here, "a thread computes different bits");
    }
    let finite = here.0.iter().all(|&bits| f32::from_bits(bits).is_finite());
    assert!(finite && here.0.len() > 100_000);
}
