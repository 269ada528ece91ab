//! The contact methods as command-line values.

use bevy_circumsphere::ContactMethod;
use clap::ValueEnum;
use serde::Serialize;

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    BoundingSphere,
    Circumsphere,
    Closest,
    Refined,
    Polygon,
}

impl From<Method> for ContactMethod {
    fn from(method: Method) -> Self {
        match method {
            Method::BoundingSphere => Self::BoundingSphere,
            Method::Circumsphere => Self::Circumsphere,
            Method::Closest => Self::Closest,
            Method::Refined => Self::Refined,
            Method::Polygon => Self::Polygon,
        }
    }
}
