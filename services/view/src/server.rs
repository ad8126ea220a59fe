//! `mluc view`: a page, and a socket that speaks the Foxglove WebSocket protocol (foxglove/ws-protocol on GitHub), on loopback alone.
//!
//! Each client has a thread, and only the newest moment is kept: a slow client misses moments. An invalid request is refused and counted.

use anyhow::Context;
use mluc_gateway::ros2::topics;
use mluc_view::{Follower, Moment, TOPICS, subscribe};
use serde_json::{Value, json};
use std::io::{ErrorKind, Read, Write};
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, PoisonError};
use std::{collections::BTreeMap, process::ExitCode, time::Duration};
use tungstenite::handshake::server::{Request, Response};
use tungstenite::protocol::WebSocketConfig;
use tungstenite::{Error, HandshakeError, Message, accept_hdr_with_config};
use tungstenite::{error::ProtocolError::ResetWithoutClosingHandshake, http::HeaderValue};

const PAGE: &str = include_str!("page.html");
const PAGE_HEAD: &str =
    "HTTP/1.1 200 OK\r\nContent-Type: text/html; charset=utf-8\r\nConnection: close\r\n\r\n";
/// Two names; for the part that is used here, both mean the same protocol.
const PROTOCOLS: [&str; 2] = ["foxglove.sdk.v1", "foxglove.websocket.v1"];
/// Origins of pages that may use the socket. A page of another site, open in a browser here, must not read what the robot sees.
const ORIGINS: [&str; 4] = ["http://127.0.0.1:", "http://localhost:", "http://[::1]:", "file://"];
const CLIENTS_MAX: usize = 8;
/// Largest request or message, bytes.
const REQUEST_MAX: usize = 8192;
/// Time limit for reading a request, and for a send that the client does not accept.
const PATIENCE: Duration = Duration::from_secs(2);
/// Interval between two checks for a new moment.
const LOOK: Duration = Duration::from_millis(10);

/// State that the clients' threads share with the pipeline's thread.
#[derive(Default)]
struct Shared {
    newest: Mutex<Option<Arc<Moment>>>,
    /// Number of refused requests and messages.
    refused: AtomicU64,
}

impl Shared {
    fn refuse(&self, what: &str) {
        let refused = self.refused.fetch_add(1, Relaxed) + 1;
        tracing::warn!(refused, "a client or its message was refused: {what}");
    }
}

pub(crate) fn view(mut follower: Follower, port: u16) -> anyhow::Result<ExitCode> {
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port));
    let listener = listener.with_context(|| format!("listening at 127.0.0.1:{port}"))?;
    let address = listener.local_addr()?;
    tracing::info!("http://{address} is the page, ws://{address} for Foxglove and Lichtblick");
    let shared = Arc::new(Shared::default());
    let own = shared.clone();
    std::thread::spawn(move || receive(&listener, &own));
    // This thread and the receiving thread hold one reference each. Any other reference belongs to a client.
    while let Some(moment) = follower.next(|| Arc::strong_count(&shared) > 2)? {
        let mut newest = shared.newest.lock().unwrap_or_else(PoisonError::into_inner);
        *newest = Some(Arc::new(moment));
    }
    Ok(ExitCode::SUCCESS)
}

/// Gives each client a thread.
fn receive(listener: &TcpListener, shared: &Arc<Shared>) {
    for stream in listener.incoming().flatten() {
        if Arc::strong_count(shared) == CLIENTS_MAX + 2 {
            shared.refuse(&format!("more than {CLIENTS_MAX} clients"));
            continue;
        }
        let shared = shared.clone();
        std::thread::spawn(move || match serve(stream, &shared) {
            Ok(()) | Err(Error::Io(_) | Error::ConnectionClosed | Error::AlreadyClosed) => (),
            Err(Error::Protocol(ResetWithoutClosingHandshake)) => (),
            Err(error) => shared.refuse(&error.to_string()),
        });
    }
}

fn serve(mut stream: TcpStream, shared: &Shared) -> Result<(), Error> {
    stream.set_read_timeout(Some(PATIENCE))?;
    stream.set_write_timeout(Some(PATIENCE))?;
    let mut request = [0; REQUEST_MAX];
    let count = stream.peek(&mut request)?;
    let text = String::from_utf8_lossy(&request[..count]).to_ascii_lowercase();
    let header = |name| text.lines().find_map(|line| line.strip_prefix(name));
    if header("upgrade: websocket").is_none() {
        stream.read_exact(&mut request[..count])?;
        return Ok(stream.write_all([PAGE_HEAD, PAGE].concat().as_bytes())?);
    }
    let is_local = |origin: &str| ORIGINS.iter().any(|local| origin.starts_with(local));
    let is_local = text.ends_with("\r\n\r\n") && header("origin: ").is_none_or(is_local);
    let offered = header("sec-websocket-protocol: ").into_iter();
    let mut offered = offered.flat_map(|names| names.split(',').map(str::trim));
    match offered.find_map(|name| PROTOCOLS.into_iter().find(|own| *own == name)) {
        Some(protocol) if is_local => converse(stream, shared, HeaderValue::from_static(protocol)),
        _ => {
            shared.refuse("expected a page of this machine, a protocol of Foxglove, and all of it in 8192 bytes at once");
            Ok(stream.write_all(b"HTTP/1.1 403 Forbidden\r\nConnection: close\r\n\r\n")?)
        }
    }
}

fn converse(stream: TcpStream, shared: &Shared, protocol: HeaderValue) -> Result<(), Error> {
    let config = WebSocketConfig::default().max_message_size(Some(REQUEST_MAX));
    let config = config.max_frame_size(Some(REQUEST_MAX));
    #[allow(clippy::result_large_err)] // tungstenite's own type
    let greet = |_: &Request, mut response: Response| {
        response.headers_mut().insert("sec-websocket-protocol", protocol);
        Ok(response)
    };
    let mut socket = match accept_hdr_with_config(stream, greet, Some(config)) {
        Ok(socket) => socket,
        Err(HandshakeError::Failure(error)) => return Err(error),
        Err(HandshakeError::Interrupted(_)) => return Ok(()),
    };
    socket.get_ref().set_read_timeout(Some(LOOK))?;
    for message in introduction() {
        socket.send(Message::text(message.to_string()))?;
    }
    let (mut subscriptions, mut sent_ns) = (BTreeMap::new(), 0);
    loop {
        let taken = match socket.read() {
            Ok(Message::Text(text)) => subscribe(&text, &mut subscriptions),
            Ok(Message::Binary(_)) => Err("a binary message".to_string()),
            Ok(Message::Close(_)) => {
                let _ = socket.flush();
                return Ok(());
            }
            Ok(_) => Ok(()),
            Err(Error::Io(error)) if error.kind() == ErrorKind::WouldBlock => Ok(()),
            Err(error) => return Err(error),
        };
        if let Err(message) = taken {
            shared.refuse(&message);
            let answer = json!({"op": "status", "level": 2, "message": message});
            socket.send(Message::text(answer.to_string()))?;
        }
        let newest = shared.newest.lock();
        let newest = newest.unwrap_or_else(PoisonError::into_inner).clone();
        let Some(moment) = newest.filter(|moment| moment.log_ns != sent_ns) else {
            continue;
        };
        sent_ns = moment.log_ns;
        for (id, topic) in &subscriptions {
            if let Some(data) = &moment.messages[*topic] {
                // Header: opcode, subscription, time.
                let head = [&[1][..], &u32::to_le_bytes(*id), &sent_ns.to_le_bytes()].concat();
                socket.send(Message::binary([&head, &data[..]].concat()))?;
            }
        }
    }
}

/// The first two messages to a client: server information and channels.
fn introduction() -> [Value; 2] {
    let mut channels = vec![json!({
        "id": TOPICS - 1, "topic": "/mluc/frame", "encoding": "json",
        "schemaName": "", "schema": "", "schemaEncoding": "jsonschema",
    })];
    for (id, topic) in topics().iter().enumerate() {
        channels.push(json!({
            "id": id, "topic": topic.name, "encoding": "cdr",
            "schemaName": topic.schema, "schema": topic.definition, "schemaEncoding": "ros2msg",
        }));
    }
    [
        json!({"op": "serverInfo", "name": "mluc", "capabilities": [], "supportedEncodings": [], "metadata": {}}),
        json!({"op": "advertise", "channels": channels}),
    ]
}
