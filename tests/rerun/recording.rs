//! Reads recorded chunks back: rows as they were logged, and what a viewer shows of them.
//!
//! The Rerun crates decode the chunks. Nothing here knows how the debug layer writes.

use std::collections::BTreeMap;

use rerun::{
    external::arrow::array::{
        Array, ArrayRef, BooleanArray, FixedSizeListArray, Float32Array, Float64Array, ListArray, StringArray,
        UInt32Array,
    },
    log::{Chunk, LogMsg, RowId},
};

/// The path of an entity, with its parts unescaped.
pub type Path = Vec<String>;

pub fn path(parts: &[&str]) -> Path {
    parts.iter().map(|&part| part.to_owned()).collect()
}

/// The components of one row by their identifier. Each is the list of its instances.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Components(pub BTreeMap<String, ArrayRef>);

/// The components that were logged together for one entity.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    pub path: Path,
    /// Empty if the row applies to all times.
    pub times: BTreeMap<String, i64>,
    pub components: Components,
    pub id: RowId,
}

/// The rows of a recording in the order in which they were logged. The rows of its layout are kept apart.
#[derive(Debug, Default)]
pub struct Recording {
    pub rows: Vec<Row>,
    pub layout: Vec<Row>,
    pub messages: Vec<LogMsg>,
}

/// What a viewer shows: the newest row of each component, unless it was cleared since.
#[derive(Clone, Debug, Default)]
pub struct Viewer(pub BTreeMap<Path, Components>);

fn rows(chunk: &Chunk) -> Vec<Row> {
    let path: Path = chunk.entity_path().iter().map(|part| part.unescaped_str().to_owned()).collect();
    let ids: Vec<RowId> = chunk.row_ids().collect();
    let row = |place: usize| {
        let times =
            chunk.timelines().iter().map(|(name, column)| (name.to_string(), column.times_raw()[place])).collect();
        let components = chunk.components().0.iter().filter_map(|(identifier, column)| {
            let list: &ListArray = &column.list_array;
            list.is_valid(place).then(|| (identifier.to_string(), list.value(place)))
        });
        Row { path: path.clone(), times, components: Components(components.collect()), id: ids[place] }
    };
    (0..ids.len()).map(row).collect()
}

impl Recording {
    pub fn of(messages: Vec<LogMsg>) -> Self {
        let mut recording = Self::default();
        for message in &messages {
            if let LogMsg::ArrowMsg(store, message) = message {
                let chunk = Chunk::from_arrow_msg(message).expect("the message is a chunk");
                chunk.sanity_check().expect("the chunk is sane");
                let of_kind = if store.is_blueprint() { &mut recording.layout } else { &mut recording.rows };
                of_kind.extend(
                    rows(&chunk).into_iter().filter(|row| row.path.first().is_none_or(|part| part != "__properties")),
                );
            }
        }
        recording.rows.sort_by_key(|row| row.id);
        recording.messages = messages;
        recording
    }

    /// The rows at and below a path, without those that clear it.
    pub fn below(&self, parts: &[&str]) -> Vec<&Row> {
        let path = path(parts);
        self.rows.iter().filter(|row| row.path.starts_with(&path) && !row.is_clear()).collect()
    }

    /// The rows of one entity.
    pub fn of_entity(&self, parts: &[&str]) -> Vec<&Row> {
        let path = path(parts);
        self.rows.iter().filter(|row| row.path == path && !row.is_clear()).collect()
    }

    /// The only row of an entity, if there is one.
    #[track_caller]
    pub fn row(&self, parts: &[&str]) -> Option<&Row> {
        let rows = self.of_entity(parts);
        assert!(rows.len() <= 1, "{parts:?} has {} rows instead of at most one", rows.len());
        rows.first().copied()
    }

    pub fn clears(&self) -> Vec<&Row> {
        self.rows.iter().filter(|row| row.is_clear()).collect()
    }

    /// The first parts of all paths with rows.
    pub fn layers(&self) -> Vec<&str> {
        let mut layers: Vec<&str> = self
            .rows
            .iter()
            .filter(|row| !row.is_clear())
            .filter_map(|row| row.path.first())
            .map(String::as_str)
            .collect();
        layers.sort_unstable();
        layers.dedup();
        layers
    }
}

impl Row {
    fn is_clear(&self) -> bool {
        self.components.0.contains_key("Clear:is_recursive")
    }

    pub fn tick(&self) -> i64 {
        self.times["tick"]
    }
}

impl Viewer {
    /// Adds the next rows, in the order in which they were logged.
    pub fn show(&mut self, recording: &Recording) {
        for row in &recording.rows {
            if let Some(recursive) = row.components.0.get("Clear:is_recursive") {
                let recursive = recursive.as_any().downcast_ref::<BooleanArray>().expect("it is a boolean").value(0);
                self.0.retain(|path, _| !(path == &row.path || recursive && path.starts_with(&row.path)));
            } else if !row.times.is_empty() {
                let shown = self.0.entry(row.path.clone()).or_default();
                shown.0.extend(row.components.0.iter().map(|(name, values)| (name.clone(), values.clone())));
            }
        }
    }

    pub fn of(&self, parts: &[&str]) -> Option<&Components> {
        self.0.get(&path(parts))
    }

    /// The components shown below a path, by the rest of their paths.
    pub fn below(&self, parts: &[&str]) -> BTreeMap<Path, &Components> {
        let path = path(parts);
        let below = self.0.iter().filter(|(other, _)| other.starts_with(&path));
        below.map(|(other, components)| (other[path.len()..].to_vec(), components)).collect()
    }
}

fn cast<T: Array + Clone + 'static>(array: &ArrayRef) -> T {
    let found = array.data_type();
    array.as_any().downcast_ref::<T>().unwrap_or_else(|| panic!("the array has another type: {found}")).clone()
}

/// The flattened values of a list of lists of fixed length.
fn flat(array: &ArrayRef) -> ArrayRef {
    match array.as_any().downcast_ref::<FixedSizeListArray>() {
        Some(list) => list.values().clone(),
        None => array.clone(),
    }
}

impl Components {
    pub fn has(&self, name: &str) -> bool {
        self.0.contains_key(name)
    }

    #[track_caller]
    fn get(&self, name: &str) -> &ArrayRef {
        let names = self.0.keys();
        self.0.get(name).unwrap_or_else(|| panic!("there is no {name} among {names:?}"))
    }

    /// The number of bytes of the numbers themselves.
    pub fn bytes(&self) -> usize {
        let of = |array: &ArrayRef| array.to_data().get_slice_memory_size().expect("the size is known");
        self.0.values().map(of).sum()
    }

    /// The largest number of instances of a component.
    pub fn longest(&self) -> usize {
        self.0.values().map(Array::len).max().unwrap_or(0)
    }

    #[track_caller]
    pub fn floats(&self, name: &str) -> Vec<f32> {
        cast::<Float32Array>(&flat(self.get(name))).values().to_vec()
    }

    #[track_caller]
    pub fn vectors<const N: usize>(&self, name: &str) -> Vec<[f32; N]> {
        let floats = self.floats(name);
        floats.chunks_exact(N).map(|chunk| chunk.try_into().expect("the chunk has the right length")).collect()
    }

    #[track_caller]
    pub fn wholes(&self, name: &str) -> Vec<u32> {
        cast::<UInt32Array>(&flat(self.get(name))).values().to_vec()
    }

    /// Whole numbers. Some may be missing.
    #[track_caller]
    pub fn optional_wholes(&self, name: &str) -> Vec<Option<u32>> {
        cast::<UInt32Array>(self.get(name)).iter().collect()
    }

    #[track_caller]
    pub fn triples(&self, name: &str) -> Vec<[u32; 3]> {
        self.wholes(name).chunks_exact(3).map(|chunk| chunk.try_into().expect("it has length 3")).collect()
    }

    #[track_caller]
    pub fn scalar(&self) -> f64 {
        let scalars = cast::<Float64Array>(self.get("Scalars:scalars"));
        assert_eq!(scalars.len(), 1);
        scalars.value(0)
    }

    #[track_caller]
    pub fn texts(&self, name: &str) -> Vec<String> {
        cast::<StringArray>(self.get(name)).iter().map(|text| text.expect("the text is not null").to_owned()).collect()
    }

    #[track_caller]
    pub fn strips(&self) -> Vec<Vec<[f32; 3]>> {
        let strips = cast::<ListArray>(self.get("LineStrips3D:strips"));
        let strip = |place: usize| {
            let floats = cast::<Float32Array>(&flat(&strips.value(place)));
            floats.values().chunks_exact(3).map(|chunk| chunk.try_into().expect("it has length 3")).collect()
        };
        (0..strips.len()).map(strip).collect()
    }
}

/// The bits of vectors, which distinguish 0 from −0.
pub fn bits<const N: usize>(vectors: impl IntoIterator<Item = [f32; N]>) -> Vec<[u32; N]> {
    vectors.into_iter().map(|vector| vector.map(f32::to_bits)).collect()
}
