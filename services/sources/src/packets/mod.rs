//! Packets of spinning LiDARs to revolutions: no clock, no file, no socket.
