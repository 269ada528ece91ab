//! Numbers per instance, for the selection panel of the viewer and for programs that read the recording.

use std::sync::Arc;

use rerun::{
    AnyValues,
    external::arrow::array::{Float32Array, StringArray, UInt32Array},
};

/// The triangles that the instances of a row belong to, numbered as in the mesh of the surface. Four bytes each.
pub(super) fn triangles(triangles: &[u32]) -> AnyValues {
    whole(AnyValues::default(), "triangle", triangles)
}

/// The pairs of triangles that the instances of a row belong to. Eight bytes each.
pub(super) fn triangle_pairs(pairs: &[[u32; 2]]) -> AnyValues {
    let side = |side: usize| pairs.iter().map(|pair| pair[side]).collect::<Vec<_>>();
    whole(whole(AnyValues::default(), "triangle_a", &side(0)), "triangle_b", &side(1))
}

/// The triangles of contacts. The second is `None` if it is a solid tested by formula.
pub(super) fn contact_triangles(pairs: &[[Option<u32>; 2]]) -> AnyValues {
    let side = |side: usize| Arc::new(pairs.iter().map(|pair| pair[side]).collect::<UInt32Array>());
    let values = AnyValues::default().with_component_from_data("triangle_a", side(0));
    values.with_component_from_data("triangle_b", side(1))
}

/// Adds an integer per instance.
pub(super) fn whole(values: AnyValues, name: &'static str, numbers: &[u32]) -> AnyValues {
    values.with_component_from_data(name, Arc::new(UInt32Array::from(numbers.to_vec())))
}

/// Adds a number per instance.
pub(super) fn number(values: AnyValues, name: &'static str, numbers: &[f32]) -> AnyValues {
    values.with_component_from_data(name, Arc::new(Float32Array::from(numbers.to_vec())))
}

/// Adds a text per instance.
pub(super) fn texts<'a>(values: AnyValues, name: &'static str, texts: impl Iterator<Item = &'a str>) -> AnyValues {
    values.with_component_from_data(name, Arc::new(StringArray::from_iter_values(texts)))
}
