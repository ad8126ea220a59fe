//! mluc-bench
