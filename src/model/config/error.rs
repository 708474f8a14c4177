//! The error of a model config that is not valid.

use thiserror::Error;

/// What is wrong with a model config.
#[derive(Debug, Error, PartialEq)]
#[error("model config: `{field}` is {found}; {valid}")]
pub struct ModelConfigError {
    pub field: &'static str,
    pub found: String,
    pub valid: &'static str,
}

/// Makes the error a result.
pub(super) fn fail<T>(
    field: &'static str,
    found: impl ToString,
    valid: &'static str,
) -> Result<T, ModelConfigError> {
    Err(ModelConfigError { field, found: found.to_string(), valid })
}
