//! mluc-head
