//! Scans from a live sensor: a thread receives its packets and keeps the newest turn for the pipeline.

use crate::packets::{Calibration, Counts, Detector, LOOKS_MAX};
use crate::{LiveScans, Next, Scan, SourceError};
use crate::{capture::CLOCK, capture::calibration, files::Layout, udp::Receiver, udp::now_ns};
use anyhow::{Context, bail};
use crossbeam_channel::{Receiver as Turns, RecvTimeoutError, Sender, TrySendError, bounded};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::time::{Duration, Instant};
use std::{net::Ipv4Addr, net::SocketAddr, path::Path, sync::Arc, thread::JoinHandle};

/// How long a read of the socket waits at most.
const SILENCE: Duration = Duration::from_millis(500);
/// A sensor that was silent for longer may return with another address.
const FORGET_MS: u64 = 5_000;
/// No turn is expected to end in a pause longer than this.
const PAUSE_MS: u64 = 500;
/// A turn takes less time, even at 1 Hz.
const NO_TURN: Duration = Duration::from_secs(3);
/// Shortest time between two log lines about missing packets.
const TELL: Duration = Duration::from_secs(10);
/// How long a wait for the next turn takes at most: ingest must report to the pipeline in between.
pub(crate) const PATIENCE: Duration = Duration::from_millis(20);
/// Prefix of an input that is an address.
const SCHEME: &str = "udp:";

/// The address of an input like `udp:2368` or `udp:10.0.0.5:2368`: port, and where to listen (or a multicast group); `None`: another kind of input.
pub(crate) fn address(input: &Path) -> Option<anyhow::Result<SocketAddr>> {
    let words = input.to_str()?.strip_prefix(SCHEME)?;
    let words = words.trim_start_matches('/');
    let anywhere = |port: u16| SocketAddr::from((Ipv4Addr::UNSPECIFIED, port));
    let address = words.parse().map(anywhere).or_else(|_| words.parse());
    let expected = "expected udp:PORT or udp:ADDRESS:PORT";
    Some(address.with_context(|| format!("input {}: {expected}", input.display())))
}

/// State that the thread and the pipeline share.
#[derive(Default)]
struct Shared {
    is_ending: AtomicBool,
    /// Number of turns that newer turns replaced.
    replaced: AtomicU64,
    /// Time since the sensor's last packet.
    silent_ms: AtomicU64,
    /// Length of the last datagram from no known sensor; 0 while a sensor is known.
    foreign_bytes: AtomicU64,
}

/// A socket, and the newest turn.
pub(crate) struct Live {
    address: SocketAddr,
    turns: Turns<Result<Scan, SourceError>>,
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

impl Live {
    pub(crate) fn open(address: SocketAddr, layout: &Layout) -> anyhow::Result<Live> {
        let receiver = Receiver::open(address, SILENCE)?;
        let bytes = receiver.buffer_bytes;
        let address = receiver.address;
        tracing::info!(%address, buffer_bytes = bytes, "listening");
        let (send, turns) = bounded(1);
        let shared = Arc::new(Shared::default());
        let mut listener = Listener {
            receiver,
            layout: layout.clone(),
            calibration: calibration(layout)?,
            oldest: turns.clone(),
            send,
            shared: shared.clone(),
        };
        let thread = std::thread::Builder::new().name("sensor".to_string());
        let thread = thread.spawn(move || {
            if let Err(error) = listener.listen() {
                listener.give(Err(error));
            }
        })?;
        Ok(Live { address, turns, shared, thread: Some(thread) })
    }
}

impl LiveScans for Live {
    fn load(&mut self, scan: &mut Scan, patience: Duration) -> anyhow::Result<Next> {
        match self.turns.recv_timeout(patience) {
            Ok(turn) => {
                *scan = turn?;
                scan.missed = self.shared.replaced.swap(0, Relaxed);
                Ok(Next::Scan)
            }
            Err(RecvTimeoutError::Timeout) => Ok(Next::NotYet),
            Err(RecvTimeoutError::Disconnected) => {
                bail!("the thread that listens to the sensor ended")
            }
        }
    }

    fn silence(&self) -> Option<String> {
        let address = self.address;
        let words = || match self.shared.foreign_bytes.load(Relaxed) {
            0 => format!("no packets of the sensor at {address}"),
            bytes => format!(
                "packets of {bytes} bytes come to {address}, of no known sensor (an Ouster needs its metadata: --calibration)"
            ),
        };
        (self.shared.silent_ms.load(Relaxed) >= 1000).then(words)
    }
}

impl Drop for Live {
    fn drop(&mut self) {
        self.shared.is_ending.store(true, Relaxed);
        if let Some(thread) = self.thread.take() {
            // The thread ends after one `SILENCE` at most. A panic in it was logged.
            let _ = thread.join();
        }
    }
}

struct Listener {
    receiver: Receiver,
    layout: Layout,
    calibration: Option<Calibration>,
    send: Sender<Result<Scan, SourceError>>,
    /// The receiving end: removes a turn that was not fetched when a newer turn is there.
    oldest: Turns<Result<Scan, SourceError>>,
    shared: Arc<Shared>,
}

impl Listener {
    fn listen(&mut self) -> Result<(), SourceError> {
        let calibration = self.calibration.take();
        let mut detector = Detector::new(calibration.as_ref());
        let (mut decoder, mut looks) = (None, 0);
        let (mut heard, mut told) = (Instant::now(), (Instant::now(), 0));
        let (mut turned, mut heard_ns) = (Instant::now(), now_ns());
        while !self.shared.is_ending.load(Relaxed) {
            let datagram = self.receiver.receive()?;
            let silent_ms = heard.elapsed().as_millis() as u64;
            self.shared.silent_ms.store(silent_ms, Relaxed);
            let Some(datagram) = datagram else {
                self.shared.foreign_bytes.store(0, Relaxed);
                continue;
            };
            // By the arrivals: this program may have been stopped meanwhile.
            let silent_ms = datagram.stamp_ns.saturating_sub(heard_ns) / 1_000_000;
            // The sensor may have returned with another address.
            if silent_ms > FORGET_MS {
                decoder = None;
            }
            if silent_ms > PAUSE_MS || decoder.is_none() {
                turned = Instant::now();
            }
            if decoder.is_none() {
                looks += 1;
                if looks > LOOKS_MAX {
                    return Err(detector.not_found());
                }
                let bytes = datagram.payload.len() as u64;
                decoder = detector.look(&datagram)?;
                let foreign = if decoder.is_some() { 0 } else { bytes };
                self.shared.foreign_bytes.store(foreign, Relaxed);
                if let Some(decoder) = &decoder {
                    tracing::info!(sensor = decoder.product(), from = %datagram.from, "packets");
                }
            }
            let Some(decoder) = &mut decoder else {
                continue;
            };
            let (before, mut turn) = (decoder.counts().packets, None);
            decoder.push(&datagram, &mut |whole| {
                let mut scan = Scan::default();
                scan.take(whole, 0, &self.layout);
                scan.name.clear();
                let waited_ns = now_ns().saturating_sub(datagram.stamp_ns);
                scan.arrived = Instant::now().checked_sub(Duration::from_nanos(waited_ns));
                turn.get_or_insert(scan);
            });
            let counts = decoder.counts();
            if counts.packets > before {
                (heard, heard_ns, looks) = (Instant::now(), datagram.stamp_ns, 0);
            }
            // What came before a pause is too old.
            if let Some(scan) = turn.filter(|_| silent_ms <= PAUSE_MS) {
                turned = Instant::now();
                self.give(Ok(scan));
            } else if turned.elapsed() > NO_TURN {
                turned = Instant::now();
                tracing::warn!("packets come, but no turn has ended for {NO_TURN:?}: {CLOCK}");
            }
            self.warn_of_missing(counts, &mut told);
        }
        Ok(())
    }

    /// Logs that packets are missing. `told`: when that was last logged, and how many were missing.
    fn warn_of_missing(&self, counts: Counts, told: &mut (Instant, u64)) {
        let dropped = self.receiver.dropped;
        let missing = counts.lost + counts.damaged + u64::from(dropped);
        // Another decoder counts from 0.
        told.1 = told.1.min(missing);
        if missing > told.1 && told.0.elapsed() > TELL {
            *told = (Instant::now(), missing);
            let (lost, damaged, other) = (counts.lost, counts.damaged, counts.other_traffic);
            tracing::warn!(lost, damaged, other, dropped, "packets are missing");
        }
    }

    /// Keeps the newest turn only: it replaces a turn that was not fetched.
    fn give(&self, scan: Result<Scan, SourceError>) {
        let mut next = Some(scan);
        while let Some(scan) = next.take() {
            if let Err(TrySendError::Full(scan)) = self.send.try_send(scan) {
                if self.oldest.try_recv().is_ok() {
                    self.shared.replaced.fetch_add(1, Relaxed);
                }
                next = Some(scan);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::packets::tests::{HOUR_NS, velodyne};
    use std::net::UdpSocket;

    /// Loads until the result is as wanted, for ten seconds at most.
    fn next(
        live: &mut Live,
        scan: &mut Scan,
        wanted: impl Fn(&anyhow::Result<Next>, &Live) -> bool,
    ) -> anyhow::Result<Next> {
        let begun = Instant::now();
        loop {
            let next = live.load(scan, PATIENCE);
            if wanted(&next, live) {
                return next;
            }
            assert!(begun.elapsed() < Duration::from_secs(10), "nothing came");
        }
    }

    #[test]
    fn the_newest_turn_wins_the_others_are_counted_and_silence_is_said() {
        let mut live = Live::open("127.0.0.1:0".parse().unwrap(), &Layout::default()).unwrap();
        let sender = UdpSocket::bind("127.0.0.1:0").unwrap();
        let send = |n: u64| {
            let packet = velodyne([34, 1, 40, 55, 0], n as u32, HOUR_NS + n * 1_327_104);
            sender.send_to(&packet, live.address).unwrap();
            std::thread::sleep(Duration::from_micros(200));
        };
        (37..37 + 75 * 4).for_each(send);
        let (mut scan, mut loaded, mut missed) = (Scan::default(), 0, 0);
        std::thread::sleep(Duration::from_millis(200));
        while loaded + missed < 4 {
            let is_scan = |next: &anyhow::Result<_>, _: &_| matches!(next, Ok(Next::Scan));
            next(&mut live, &mut scan, is_scan).unwrap();
            (loaded, missed) = (loaded + 1, missed + scan.missed);
        }
        assert_eq!((scan.bytes.len() / 16, loaded + missed), (75 * 384, 4));
        assert_eq!(scan.name, "");
        next(&mut live, &mut scan, |_, live| live.silence().is_some()).unwrap();
    }

    #[test]
    fn packets_of_no_known_sensor_are_an_error_in_the_end() {
        let mut live = Live::open("127.0.0.1:0".parse().unwrap(), &Layout::default()).unwrap();
        let sender = UdpSocket::bind("127.0.0.1:0").unwrap();
        let mut scan = Scan::default();
        let error = next(&mut live, &mut scan, |next, live| {
            (0..1000).for_each(|_| drop(sender.send_to(&[7; 600], live.address)));
            next.is_err()
        });
        let error = error.unwrap_err().to_string();
        assert!(error.contains("datagrams of [600] bytes"), "{error}");
    }

    #[test]
    fn addresses_are_told_from_paths() {
        for (input, expected) in [
            ("udp:2368", Some("0.0.0.0:2368")),
            ("udp://10.0.0.5:2369", Some("10.0.0.5:2369")),
            ("scans/udp:2368", None),
        ] {
            let found = address(Path::new(input)).map(|found| found.unwrap().to_string());
            assert_eq!(found.as_deref(), expected);
        }
        assert!(address(Path::new("udp:x")).unwrap().is_err());
    }

    #[test]
    fn options_without_an_effect_are_told_by_the_kind_of_input() {
        let mut layout = Layout {
            columns: vec!["x".into()],
            calibration: Some("any".into()),
            topic: Some("any".into()),
            odometry: Some("any".into()),
            ..Layout::default()
        };
        for (input, deskew, idle) in [
            ("scans", false, "calibration topic odometry"),
            ("follow:scans", true, "calibration topic odometry"),
            ("udp:2368", false, "columns topic odometry"),
            ("drive.pcap", false, "columns topic odometry"),
            ("drive.mcap", false, "columns calibration odometry"),
            ("drive.mcap", true, "columns calibration"),
            ("ros2:/points", true, "columns calibration topic"),
        ] {
            layout.deskew = deskew;
            let found = crate::idle_options(Path::new(input), &layout);
            assert_eq!(found.join(" "), idle, "{input}");
        }
    }
}
