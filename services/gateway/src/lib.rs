//! mluc-gateway
