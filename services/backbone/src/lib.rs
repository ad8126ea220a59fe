//! mluc-backbone
