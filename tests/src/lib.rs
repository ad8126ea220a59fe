//! mluc-tests
