//! UDP datagrams of a live sensor.
//!
//! The kernel's receive buffer is the queue. It is bounded, and the kernel counts the datagrams that do not fit. So a reader loses nothing while the
//! buffer is not full, and otherwise knows how many datagrams it lost. The kernel stamps each datagram on arrival.

use crate::{SourceError, packets::Datagram};
use nix::sys::socket::{
    ControlMessageOwned, MsgFlags, SockFlag, SockType, SockaddrLike, SockaddrStorage,
    bind as bind_socket, getsockopt, recvmsg, setsockopt, socket, sockopt,
};
use nix::{cmsg_space, errno::Errno, sys::time::TimeSpec};
use std::io::{Error, ErrorKind, IoSliceMut};
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};
use std::os::fd::AsRawFd;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// Half a second of data from the fastest sensor (VLS-128, two returns: 22 MB/s), rounded up; the system may grant less.
const BUFFER_BYTES: usize = 16 << 20;
const DATAGRAM_BYTES_MAX: usize = 65_535;

/// A socket that listens to a sensor.
pub struct Receiver {
    socket: UdpSocket,
    /// The address at which the socket listens.
    pub address: SocketAddr,
    payload: Vec<u8>,
    control: Vec<u8>,
    /// Buffer size that the system granted of 16 MiB. Less than a tenth of a second of the sensor's data is too little: raise `net.core.rmem_max`.
    pub buffer_bytes: usize,
    /// Datagrams that the kernel dropped because the buffer was full, as of the last datagram that came.
    pub dropped: u32,
}

impl Receiver {
    /// Listens at an address that this machine has or gets later (0.0.0.0: all), or joins a multicast group. `silence`: longest wait of [`Self::receive`].
    pub fn open(address: SocketAddr, silence: Duration) -> Result<Receiver, SourceError> {
        let refused = |cause: Error| SourceError::io(format_args!("UDP {address}"), cause);
        let socket = bind(address, silence).map_err(refused)?;
        let buffer_bytes = options(&socket).map_err(|errno| refused(errno.into()))?;
        let address = socket.local_addr().map_err(refused)?;
        Ok(Receiver {
            socket,
            address,
            payload: vec![0; DATAGRAM_BYTES_MAX],
            control: cmsg_space!(TimeSpec, u32),
            buffer_bytes,
            dropped: 0,
        })
    }

    /// The next datagram; `None`: none came within `silence`.
    pub fn receive(&mut self) -> Result<Option<Datagram<'_>>, SourceError> {
        let mut parts = [IoSliceMut::new(&mut self.payload)];
        let (bytes, from, stamp_ns) = loop {
            let control = Some(&mut self.control[..]);
            let fd = self.socket.as_raw_fd();
            match recvmsg::<SockaddrStorage>(fd, &mut parts, control, MsgFlags::empty()) {
                Ok(message) => {
                    let mut stamp_ns = None;
                    for part in message.cmsgs().into_iter().flatten() {
                        match part {
                            ControlMessageOwned::ScmTimestampns(time) => {
                                stamp_ns = u64::try_from(Duration::from(time).as_nanos()).ok();
                            }
                            ControlMessageOwned::RxqOvfl(dropped) => self.dropped = dropped,
                            _ => {}
                        }
                    }
                    let from = message.address.as_ref().and_then(socket_address);
                    break (message.bytes, from, stamp_ns.unwrap_or_else(now_ns));
                }
                Err(Errno::EAGAIN) => return Ok(None),
                Err(Errno::EINTR) => {}
                Err(errno) => {
                    return Err(SourceError::io(format_args!("UDP {}", self.address), errno));
                }
            }
        };
        Ok(Some(Datagram {
            stamp_ns,
            from: from.unwrap_or(SocketAddr::new(Ipv4Addr::UNSPECIFIED.into(), 0)),
            to_port: self.address.port(),
            payload: &self.payload[..bytes],
        }))
    }
}

fn bind(address: SocketAddr, silence: Duration) -> Result<UdpSocket, Error> {
    let (any, port) = (Ipv4Addr::UNSPECIFIED, address.port());
    let socket = match address.ip() {
        IpAddr::V4(group) if group.is_multicast() => {
            let socket = UdpSocket::bind((any, port))?;
            socket.join_multicast_v4(&group, &any)?;
            socket
        }
        IpAddr::V6(group) if group.is_multicast() => {
            let socket = UdpSocket::bind((Ipv6Addr::UNSPECIFIED, port))?;
            socket.join_multicast_v6(&group, 0)?;
            socket
        }
        own => UdpSocket::bind((own, port)).or_else(|error| match error.kind() {
            ErrorKind::AddrNotAvailable => bind_ahead(address),
            _ => Err(error),
        })?,
    };
    socket.set_read_timeout(Some(silence))?;
    Ok(socket)
}

/// Binds to an address that this machine does not have yet: its network comes up together with the sensor.
fn bind_ahead(address: SocketAddr) -> Result<UdpSocket, Error> {
    tracing::warn!(%address, "no such address on this machine yet: waiting for it");
    let address = SockaddrStorage::from(address);
    let family = address.family().ok_or(Errno::EAFNOSUPPORT)?;
    let socket = socket(family, SockType::Datagram, SockFlag::SOCK_CLOEXEC, None)?;
    setsockopt(&socket, sockopt::IpFreebind, &true)?;
    bind_socket(socket.as_raw_fd(), &address)?;
    Ok(socket.into())
}

/// Requests the buffer, the stamps and the count of drops; returns the buffer's size.
fn options(socket: &UdpSocket) -> Result<usize, Errno> {
    setsockopt(socket, sockopt::RcvBuf, &BUFFER_BYTES)?;
    setsockopt(socket, sockopt::ReceiveTimestampns, &true)?;
    setsockopt(socket, sockopt::RxqOvfl, &1)?;
    // Linux doubles the requested size, for its own use.
    Ok(getsockopt(socket, sockopt::RcvBuf)? / 2)
}

fn socket_address(address: &SockaddrStorage) -> Option<SocketAddr> {
    let v4 = address.as_sockaddr_in().map(|v4| SocketAddr::from(*v4));
    v4.or_else(|| address.as_sockaddr_in6().map(|v6| SocketAddr::from(*v6)))
}

pub(crate) fn now_ns() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_nanos() as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn datagrams_come_with_sender_and_time_and_silence_is_said() {
        let later = SocketAddr::from(([192, 0, 2, 77], 0));
        assert!(Receiver::open(later, Duration::from_millis(20)).is_ok());
        let local = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));
        let mut receiver = Receiver::open(local, Duration::from_millis(20)).unwrap();
        let sender = UdpSocket::bind(local).unwrap();
        let before_ns = now_ns();
        sender.send_to(b"points", receiver.address).unwrap();
        let port = receiver.address.port();
        let datagram = receiver.receive().unwrap().expect("a datagram");
        assert_eq!((datagram.payload, datagram.to_port), (&b"points"[..], port));
        assert_eq!(datagram.from, sender.local_addr().unwrap());
        // Stamped by the kernel's clock, which may be some milliseconds coarse.
        assert!(datagram.stamp_ns.abs_diff(before_ns) < 60_000_000_000);
        assert!(receiver.receive().unwrap().is_none());
    }

    #[test]
    fn what_the_buffer_does_not_hold_is_counted() {
        let local = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));
        let mut receiver = Receiver::open(local, Duration::from_millis(20)).unwrap();
        let sender = UdpSocket::bind(local).unwrap();
        let sent = receiver.buffer_bytes / 1206 * 4;
        for _ in 0..sent {
            sender.send_to(&[0; 1206], receiver.address).unwrap();
        }
        let mut received = 0;
        while receiver.receive().unwrap().is_some() {
            received += 1;
        }
        // The count comes with the next datagram that fits.
        sender.send_to(&[0; 1206], receiver.address).unwrap();
        assert!(receiver.receive().unwrap().is_some());
        assert!(received < sent, "{received} of {sent} fit");
        assert_eq!(received + receiver.dropped as usize, sent);
    }
}
