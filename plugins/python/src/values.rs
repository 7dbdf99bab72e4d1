//! Content of a scene file, as Python has it: mappings, lists, texts and numbers.

use std::collections::BTreeMap;

use pyo3::prelude::*;

use crate::errors::usage;

/// A value of a scene file. The first that fits is taken; a number of Python is no truth value.
#[derive(FromPyObject, IntoPyObject)]
pub(crate) enum Value {
    Boolean(bool),
    Integer(i64),
    Float(f64),
    Text(String),
    List(Vec<Value>),
    Table(BTreeMap<String, Value>),
}

impl From<Value> for toml::Value {
    fn from(value: Value) -> Self {
        match value {
            Value::Boolean(value) => Self::Boolean(value),
            Value::Integer(value) => Self::Integer(value),
            Value::Float(value) => Self::Float(value),
            Value::Text(value) => Self::String(value),
            Value::List(values) => Self::Array(values.into_iter().map(Self::from).collect()),
            Value::Table(values) => {
                Self::Table(values.into_iter().map(|(key, value)| (key, Self::from(value))).collect())
            }
        }
    }
}

impl From<toml::Value> for Value {
    fn from(value: toml::Value) -> Self {
        match value {
            toml::Value::Boolean(value) => Self::Boolean(value),
            toml::Value::Integer(value) => Self::Integer(value),
            toml::Value::Float(value) => Self::Float(value),
            toml::Value::String(value) => Self::Text(value),
            toml::Value::Datetime(value) => Self::Text(value.to_string()),
            toml::Value::Array(values) => Self::List(values.into_iter().map(Self::from).collect()),
            toml::Value::Table(values) => {
                Self::Table(values.into_iter().map(|(key, value)| (key, Self::from(value))).collect())
            }
        }
    }
}

/// The text of a scene file that holds this.
#[pyfunction]
pub(crate) fn toml_of(content: BTreeMap<String, Value>) -> PyResult<String> {
    toml::to_string(&toml::Value::from(Value::Table(content))).map_err(|error| usage(error.to_string()))
}

/// Content of a scene file, from its text.
#[pyfunction]
pub(crate) fn content_of(text: &str) -> PyResult<Value> {
    toml::from_str(text)
        .map(|content: toml::Table| toml::Value::Table(content).into())
        .map_err(|error| usage(error.to_string()))
}
