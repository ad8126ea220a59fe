//! `mluc monitor` and `mluc top` next to a running pipeline.

use mluc_tests::{Running, Setting, assert_has, mluc_program, wait_for};
use rustix::process::Signal;
use serde_json::Value;
use std::{io::Write, net::TcpStream, process::Command, time::Duration};

/// The whole response to a GET.
fn get(address: &str, path: &str) -> String {
    let mut client = TcpStream::connect(address).expect("listening");
    let request = format!("GET {path} HTTP/1.1\r\nHost: a\r\n\r\n");
    client.write_all(request.as_bytes()).expect("sent");
    std::io::read_to_string(client).expect("answered")
}

/// A monitor, and its address.
fn monitor(instance: &str) -> (Running, String) {
    let words = ["monitor", "--instance", instance, "--listen", "127.0.0.1:0"];
    let mut monitor = Running::mluc(words);
    let address = monitor.wait_for_address("has /healthz");
    (monitor, address)
}

#[test]
fn consumers_that_are_killed_leave_room_for_others() {
    let setting = Setting::new("killed", 3);
    let run = setting.up("--pace sensor --rate 10 --loop");
    for _ in 0..12 {
        let (monitor, address) = monitor(&setting.instance);
        let sees = || get(&address, "/metrics").contains("mluc_sees 1\n");
        assert!(wait_for(Duration::from_secs(20), sees), "{}", monitor.log());
        monitor.signal(Signal::KILL);
        monitor.finish();
    }
    setting.stop(run);
}

#[test]
fn a_monitor_tells_how_the_pipeline_is_and_never_stops_it() {
    let setting = Setting::new("monitor", 3);
    // The monitor starts before the pipeline.
    let (monitor, address) = monitor(&setting.instance);
    let ask = |path: &str| get(&address, path);
    assert_has(&ask("/readyz"), &["503", "no supervisor"]);

    let mut run = setting.up("--pace sensor --rate 10 --budget-ms 2000 --loop");
    run.wait_for_lines(5);
    let becomes = |is_so: &dyn Fn() -> bool| wait_for(Duration::from_secs(20), is_so);
    let is_ready = || ask("/readyz").starts_with("HTTP/1.1 200 OK\r\n");
    assert!(becomes(&is_ready), "{}", ask("/readyz"));
    let metrics = ask("/metrics");
    assert_has(&metrics, &["text/plain; version=0.0.4", "mluc_sees 1\n"]);
    assert_has(&metrics, &["mluc_stage_up{stage=\"refiner\"} 1\n"]);
    let status = ask("/status.json");
    let (_, body) = status.split_once("\r\n\r\n").expect("a body");
    let status: Value = serde_json::from_str(body).expect("JSON");
    assert_eq!(status["instance"], setting.instance.as_str());
    assert!(status["status"]["frames_out"].as_u64() >= Some(1), "{status}");

    // The monitor drops a client that sends nothing.
    let silent = TcpStream::connect(&address).expect("listening");
    assert!(ask("/healthz").starts_with("HTTP/1.1 200"));
    drop(silent);
    // A monitor that hangs stops nothing. A supervisor that hangs is reported.
    monitor.signal(Signal::STOP);
    run.wait_for_lines(20);
    monitor.signal(Signal::CONT);
    run.signal(Signal::STOP);
    let is_told = || ask("/healthz").contains("the supervisor hangs or is gone");
    assert!(becomes(&is_told), "{}", ask("/healthz"));
    run.signal(Signal::CONT);
    run.stop();
    setting.stop(monitor);
}

#[test]
fn top_and_status_print_a_page_that_is_no_terminal() {
    let setting = Setting::new("top", 3);
    let mut run = setting.up("--pace sensor --rate 10 --loop");
    run.wait_for_lines(3);
    let of = |command: &[&str]| {
        let mut mluc = Command::new(mluc_program());
        mluc.args(command).env("MLUC_INSTANCE", &setting.instance);
        let finished = Running::start(&mut mluc).finish();
        assert_eq!(finished.code, Some(0), "{}", finished.log);
        finished.text()
    };
    let words = ["state: ", "newest result", "ingest", "refiner", "p99 ms"];
    let (top, status) = (of(&["top", "--once"]), of(&["status"]));
    assert_has(&top, &words);
    assert_has(&top, &["Hz", "#"]);
    assert!(!top.contains('\x1b'), "{top}");
    assert_has(&status, &words);
    setting.stop(run);
}
