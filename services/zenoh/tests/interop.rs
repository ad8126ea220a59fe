//! Another client at the other end: the Python package of zenoh receives the objects that `mluc up` prints (`client.py`).

use mluc_tests::{Running, Setting, python_with, root};
use serde_json::{Value, json};
use std::{net::TcpListener, process::Command};

#[test]
fn a_client_from_a_package_hears_the_frames_though_it_comes_late_and_comes_again() {
    let Some(python) = python_with("zenoh") else {
        return;
    };
    let free = TcpListener::bind("127.0.0.1:0").expect("a socket");
    let port = free.local_addr().expect("an address").port().to_string();
    drop(free);
    let setting = Setting::new("zenoh", 3);
    let config = setting.config("[sensor]\nextrinsics = [0.5, 0.0, 1.0, 0.0, 0.0, 0.0]\n");
    let run = setting.up(&format!("{config} --pace sensor --rate 5 --loop"));
    let words =
        format!("zenoh --points --instance {} --connect tcp/127.0.0.1:{port}", setting.instance);
    let publish = Running::mluc(words.split(' '));
    let hear = || {
        let mut client = Command::new(&python);
        client.arg(root().join("services/zenoh/tests/client.py"));
        let client = Running::start(client.args([&port, "5"])).finish();
        assert_eq!(client.code, Some(0), "{} {}", client.log, run.log());
        client.lines
    };
    let heard = [hear(), hear()];
    publish.stop().assert_says(&["ended"]);
    let run = setting.stop(run);
    for mut heard in heard {
        let keys = ["diagnostics", "frame", "objects", "points", "tf"];
        assert_eq!(heard.pop(), Some(json!({"keys": keys})));
        for frame in heard {
            let keys = ["sequence", "objects", "stages"];
            let same = |line: &Value| keys.iter().all(|key| line[key] == frame[key]);
            assert!(run.lines.iter().any(same), "{frame}");
        }
    }
}
