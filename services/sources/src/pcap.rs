//! UDP payloads of a capture file (pcap, pcapng).
