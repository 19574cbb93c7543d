//! In words, from the numbers.

use super::Paper2014;
use crate::measure::paper2008::Finding;

impl Paper2014 {
    /// §3.1.
    pub fn relaxation_findings(&self) -> Vec<Finding> {
        Vec::new()
    }
    /// §3.2.
    pub fn selection_findings(&self) -> Vec<Finding> {
        Vec::new()
    }
    /// §3.3.
    pub fn escape_findings(&self) -> Vec<Finding> {
        Vec::new()
    }
    /// §3.4.
    pub fn smoothing_findings(&self) -> Vec<Finding> {
        Vec::new()
    }
    /// §3.5.
    pub fn convex_findings(&self) -> Vec<Finding> {
        Vec::new()
    }
    /// §4.
    pub fn together_findings(&self) -> Vec<Finding> {
        Vec::new()
    }
}
