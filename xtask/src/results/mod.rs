//! An experiment from nothing: data, the trainings of every row, their scores, and `RESULTS.md`.
//!
//! ```text
//! <out>/id/ ood/              data sets, unless others are given
//! <out>/runs/<row>/           one training a row, resumable
//! <out>/scores/<row>.json     what that row came to; there when the row is done
//! <out>/scores/side-by-side-<number>.json  rows on the same samples
//! <out>/scores/<row>-id.json  all figures of its scoring, and <row>-ood.json
//! <out>/report/id/ ood/       the headline's scores with faults, sweeps and pictures, as `harmzone report` reads them
//! <out>/test/ test-ood/       data sets to report on, with --final; test-maps/ and test-maps-ood/ where further maps are there
//! <out>/scores/reported.json  the headline's figures on them, and on all of them together; all of their scoring in
//!                             <out>/report/test/, test-all/ and so on, with each network's boxes
//! <out>/results.json          all of it; results.csv and RESULTS.md are written from it alone
//! <out>/report.html           one page of report/ and results.json; there once the headline is scored
//! ```

mod closed_set;
mod config;
mod data;
mod experiment;
mod found;
mod page;
mod reported;
mod request;
mod run;
mod score;
mod side_by_side;
mod split_test;
mod write;

pub use config::ResultsConfig;
pub use request::{ReportStamp, Request};
pub use run::run;
pub use write::rewrite;
