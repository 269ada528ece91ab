//! Surfaces and shapes in files and messages. A surface is its topology, and the mean edge length of the mesh that it was
//! made from. A shape is written as parry writes it, and checked when it is read.

use std::sync::Arc;

use parry3d::shape::SharedShape;
use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error};

use super::{
    components::DeformableSurface,
    rigid_shape::{self, RigidShape},
};
use crate::kernel::mesh::topology::SurfaceTopology;

#[derive(Serialize)]
#[serde(rename = "DeformableSurface")]
struct Written<'a> {
    topology: &'a SurfaceTopology,
    mean_edge: f32,
}

#[derive(Deserialize)]
#[serde(rename = "DeformableSurface", deny_unknown_fields)]
struct Read {
    topology: SurfaceTopology,
    mean_edge: f32,
}

impl Serialize for DeformableSurface {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        Written { topology: &self.topology, mean_edge: self.mean_edge }.serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for DeformableSurface {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let Read { topology, mean_edge } = Read::deserialize(deserializer)?;
        if !(mean_edge.is_finite() && mean_edge >= 0.0) {
            return Err(D::Error::custom(format!("the mean edge length is {mean_edge}: it must be finite, 0 or more")));
        }
        Ok(Self { topology: Arc::new(topology), mean_edge })
    }
}

#[derive(Deserialize)]
#[serde(rename = "RigidShape")]
struct ReadShape(SharedShape);

impl<'de> Deserialize<'de> for RigidShape {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let ReadShape(shape) = ReadShape::deserialize(deserializer)?;
        rigid_shape::check(&shape).map_err(D::Error::custom)?;
        Ok(Self(shape))
    }
}
