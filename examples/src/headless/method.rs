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
    Exact,
    Polygon,
}

impl From<Method> for ContactMethod {
    fn from(method: Method) -> Self {
        match method {
            Method::BoundingSphere => Self::BoundingSphere,
            Method::Circumsphere => Self::Circumsphere,
            Method::Closest => Self::Closest,
            Method::Exact => Self::Exact,
            Method::Polygon => Self::Polygon,
        }
    }
}
