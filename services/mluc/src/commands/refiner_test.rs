//! `mluc refiner-test`: `mluc-contract refiner`, under the name that people know.

use std::process::ExitCode;

use crate::external::{ExternalArgs, external};

pub(crate) fn refiner_test(_: ExternalArgs) -> anyhow::Result<ExitCode> {
    external("mluc-contract", "mluc-contract", &["refiner"])
}
