//! `mluc monitor`: health, readiness, metrics and status over HTTP, on a loopback address.
//!
//! It is a separate process that observes the pipeline: however slow its clients are, the pipeline never waits for it. It serves
//! one client at a time, with limits on time and bytes. A few lines of HTTP/1.1 replace the dependencies of a server.

use super::metrics::metrics;
use super::observe::{Observer, Snapshot, instance};
use anyhow::Context;
use mluc_ipc_types::StatusState;
use mluc_runtime::log_to_stderr;
use std::io::{self, ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::{process::ExitCode, time::Duration, time::Instant};

/// Time between two polls of the pipeline and of the clients.
const LOOK: Duration = Duration::from_millis(20);
/// Time limit of a client's request, and of each write of the response.
const CLIENT_PATIENCE: Duration = Duration::from_millis(500);
/// Bytes of the longest request.
const REQUEST_MAX: usize = 4096;
const PAGES: &str = "/healthz /readyz /metrics /status.json";

/// Parses an address of the command line. Only loopback addresses are accepted: other machines cannot connect.
pub(crate) fn loopback(text: &str) -> Result<SocketAddr, String> {
    let address = text.parse::<SocketAddr>().ok();
    let address = address.filter(|address| address.ip().is_loopback());
    address.ok_or("expected 127.0.0.1:PORT or [::1]:PORT; a proxy may let others in".to_string())
}

pub(crate) fn monitor(name: Option<&str>, address: SocketAddr) -> anyhow::Result<ExitCode> {
    log_to_stderr("monitor", "info");
    let mut observer = Observer::open(&instance(name)?)?;
    let listener = TcpListener::bind(address).with_context(|| format!("listening at {address}"))?;
    listener.set_nonblocking(true)?;
    tracing::info!("http://{} has {PAGES}", listener.local_addr()?);
    while !observer.shell.is_stopping() {
        let snapshot = observer.look()?;
        match listener.accept() {
            // Errors of a client are ignored.
            Ok((client, _)) => drop(serve(client, &snapshot)),
            Err(error) => {
                if error.kind() != ErrorKind::WouldBlock {
                    tracing::warn!(%error, "a client could not be taken");
                }
                std::thread::sleep(LOOK);
            }
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// Reads one request, answers, and closes.
fn serve(mut client: TcpStream, snapshot: &Snapshot) -> io::Result<()> {
    let begun = Instant::now();
    let mut request = [0; REQUEST_MAX];
    let mut length = 0;
    client.set_nonblocking(false)?;
    client.set_write_timeout(Some(CLIENT_PATIENCE))?;
    while !request[..length].ends_with(b"\r\n\r\n") {
        let left = CLIENT_PATIENCE.saturating_sub(begun.elapsed());
        if left.is_zero() || length == REQUEST_MAX {
            return Err(ErrorKind::TimedOut.into());
        }
        client.set_read_timeout(Some(left))?;
        match client.read(&mut request[length..])? {
            0 => return Ok(()),
            count => length += count,
        }
    }
    let request = String::from_utf8_lossy(&request[..length]);
    let (code, kind, body) = answer(&request, snapshot);
    let length = body.len();
    let head = format!(
        "HTTP/1.1 {code}\r\nContent-Type: {kind}\r\nContent-Length: {length}\r\nConnection: close\r\n\r\n"
    );
    client.write_all((head + &body).as_bytes())
}

/// Code, type and text of a page.
fn answer(request: &str, snapshot: &Snapshot) -> (&'static str, &'static str, String) {
    // Of an answer to HEAD the client reads the head alone.
    let asked = request.strip_prefix("GET ").or(request.strip_prefix("HEAD "));
    let path = asked.unwrap_or("").split([' ', '?']).next().unwrap_or("");
    let state = snapshot.state();
    let plain = "text/plain; charset=utf-8";
    let if_so = |is_so: bool| {
        let codes = ["503 Service Unavailable", "200 OK"];
        (codes[usize::from(is_so)], plain, snapshot.headline() + "\n")
    };
    match path {
        "/healthz" => if_so(state.is_some_and(|state| state != StatusState::Stopped)),
        "/readyz" => if_so(state.is_some_and(StatusState::sees)),
        "/metrics" => ("200 OK", "text/plain; version=0.0.4", metrics(snapshot)),
        "/status.json" => ("200 OK", "application/json", snapshot.as_json().to_string()),
        _ => ("404 Not Found", plain, format!("GET {PAGES}\n")),
    }
}

#[cfg(test)]
mod tests {
    use super::super::observe::tests::snapshot;
    use super::*;

    #[test]
    fn pages_have_their_codes_and_nothing_listens_beyond_loopback() {
        let (blind, nobody) = (snapshot(StatusState::Blind), Snapshot::default());
        let running = snapshot(StatusState::Running);
        for (request, codes) in [
            ("GET /healthz", "200 200 503"),
            ("GET /readyz?verbose", "200 503 503"),
            ("GET /metrics", "200 200 200"),
            ("GET /status.json", "200 200 200"),
            ("GET /", "404 404 404"),
            ("POST /readyz", "404 404 404"),
            ("\u{0}\u{ff}", "404 404 404"),
        ] {
            let found = [&running, &blind, &nobody].map(|seen| &answer(request, seen).0[..3]);
            assert_eq!(found.join(" "), codes, "{request}");
        }
        let is_taken = |text: &&str| loopback(text).is_ok();
        assert!(["127.0.0.1:9464", "[::1]:0"].iter().all(is_taken));
        let refused = ["0.0.0.0:9464", "192.168.0.2:80", "localhost", "9464"];
        assert!(!refused.iter().any(is_taken));
    }
}
