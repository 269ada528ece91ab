//! Bodies and tethers in files and messages: what they were made from, and what they remember of the last tick. All of it
//! is checked when it is read.

use std::sync::Arc;

use glam::{DAffine3, Vec3};
use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error};

use super::{
    body::{XpbdBody, check_finite, count},
    error::XpbdBodyError,
    material::XpbdMaterial,
    rest::RestShape,
    tethers::{Place, Tether, TetherTarget, XpbdTethers},
};
use crate::kernel::{mesh::topology::SurfaceTopology, pose::Pose};

#[derive(Serialize)]
#[serde(rename = "XpbdBody")]
struct WrittenBody<'a> {
    mesh: &'a SurfaceTopology,
    rest_positions: &'a [Vec3],
    tetrahedra: Option<&'a [[u32; 4]]>,
    material: XpbdMaterial,
    inverse_masses: &'a [f32],
    velocities: &'a [Vec3],
    written: &'a [Vec3],
    stood: Option<DAffine3>,
}

#[derive(Deserialize)]
#[serde(rename = "XpbdBody", deny_unknown_fields)]
struct ReadBody {
    mesh: SurfaceTopology,
    rest_positions: Vec<Vec3>,
    #[serde(default)]
    tetrahedra: Option<Vec<[u32; 4]>>,
    material: XpbdMaterial,
    inverse_masses: Vec<f32>,
    velocities: Vec<Vec3>,
    written: Vec<Vec3>,
    stood: Option<DAffine3>,
}

impl Serialize for XpbdBody {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let Self { velocities, inverse_masses, material, mesh, rest, written, stood } = self;
        WrittenBody {
            mesh,
            rest_positions: &rest.positions,
            tetrahedra: rest.inside.as_ref().map(|inside| &*inside.tetrahedra),
            material: *material,
            inverse_masses,
            velocities,
            written,
            stood: stood.map(|pose| pose.to_affine()),
        }
        .serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for XpbdBody {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let read = ReadBody::deserialize(deserializer)?;
        let stood = read.stood.map(|affine| Pose::from_double_affine(&affine)).transpose().map_err(D::Error::custom)?;
        body(read, stood).map_err(D::Error::custom)
    }
}

fn body(read: ReadBody, stood: Option<Pose>) -> Result<XpbdBody, XpbdBodyError> {
    let ReadBody { mesh, rest_positions, tetrahedra, material, inverse_masses, velocities, written, .. } = read;
    let vertices = mesh.vertex_count();
    count("rest positions", vertices, rest_positions.len())?;
    check_finite(&rest_positions)?;
    if !written.is_empty() {
        count("written positions", vertices, written.len())?;
        check_finite(&written)?;
    }
    let mesh = Arc::new(mesh);
    let rest = Arc::new(RestShape::new(&mesh, &rest_positions, tetrahedra.as_deref())?);
    let body = XpbdBody { velocities, inverse_masses, material, mesh: Arc::clone(&mesh), rest, written, stood };
    body.check(&mesh, vertices)?;
    Ok(body)
}

#[derive(Serialize)]
#[serde(rename = "XpbdTethers")]
struct WrittenTethers<'a> {
    tethers: &'a [Tether],
    last: Vec<Option<Place>>,
}

#[derive(Deserialize)]
#[serde(rename = "XpbdTethers", deny_unknown_fields)]
struct ReadTethers {
    tethers: Vec<Tether>,
    /// Where the target of each was at the end of the last tick. None of new tethers.
    #[serde(default)]
    last: Vec<Option<Place>>,
}

impl Serialize for XpbdTethers {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let last = self.last_places().collect();
        WrittenTethers { tethers: &self.tethers, last }.serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for XpbdTethers {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let ReadTethers { tethers, last } = ReadTethers::deserialize(deserializer)?;
        if !last.is_empty() && last.len() != tethers.len() {
            let counts = format!("there are {} tethers and {} last places", tethers.len(), last.len());
            return Err(D::Error::custom(counts));
        }
        let known = last.iter().flatten();
        let places = known.clone().all(|place| place.at.is_finite() && place.normal.is_finite());
        let mut all = tethers.iter().chain(known.map(|place| &place.tether));
        if !places || !all.all(|tether| is_finite(&tether.target)) {
            return Err(D::Error::custom("a place of a tether is not finite"));
        }
        Ok(Self::known(tethers, last))
    }
}

fn is_finite(target: &TetherTarget) -> bool {
    match target {
        TetherTarget::Surface { barycentric, height, .. } => {
            barycentric.iter().chain([height]).all(|number| number.is_finite())
        }
        TetherTarget::Entity { point, .. } | TetherTarget::World(point) => point.is_finite(),
    }
}
