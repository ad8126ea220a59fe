//! mluc-runtime
