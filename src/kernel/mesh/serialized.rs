//! A topology in files and messages: what it was made from. The rest is found again, and checked, when it is read.

use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error};

use super::topology::SurfaceTopology;

#[derive(Serialize)]
#[serde(rename = "SurfaceTopology")]
struct Written<'a> {
    weld: &'a [u32],
    triangles: &'a [[u32; 3]],
}

#[derive(Deserialize)]
#[serde(rename = "SurfaceTopology", deny_unknown_fields)]
struct Read {
    weld: Vec<u32>,
    triangles: Vec<[u32; 3]>,
}

impl Serialize for SurfaceTopology {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        Written { weld: self.weld(), triangles: self.triangles() }.serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for SurfaceTopology {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let Read { weld, triangles } = Read::deserialize(deserializer)?;
        Self::from_weld(weld, &triangles).map_err(D::Error::custom)
    }
}
