//! mluc-ingest
