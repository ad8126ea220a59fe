//! UDP payloads of a live sensor.
