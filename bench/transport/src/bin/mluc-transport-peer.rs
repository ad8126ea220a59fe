//! The other side of a measurement, for tests: their own program cannot be it.

fn main() -> Result<(), mluc_transport::TransportError> {
    mluc_transport::serve_peer().map(|_| ())
}
