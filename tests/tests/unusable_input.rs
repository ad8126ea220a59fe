//! Files that are no scans do not end in success.

use mluc_tests::{Pipeline, clean_folder, unique_instance, untrained_model};

#[test]
fn a_run_without_a_usable_frame_fails_and_one_with_a_usable_frame_does_not() {
    let folder = tempfile::tempdir().unwrap();
    let model = untrained_model(folder.path());
    let input = folder.path().join("garbage");
    std::fs::create_dir(&input).unwrap();
    let not_finite: Vec<u8> = f32::NAN.to_le_bytes().repeat(4 * 1000);
    for (name, bytes) in [
        ("empty", &b""[..]),
        ("text", b"hello"),
        ("nan", &not_finite),
    ] {
        std::fs::write(input.join(format!("{name}.bin")), bytes).unwrap();
    }
    let run = |label: &str, input| {
        Pipeline::up(
            &unique_instance(label),
            &model,
            input,
            &["--pace", "complete"],
        )
        .finish()
    };
    let garbage = run("garbage", &input);
    assert_eq!(
        (garbage.code, garbage.lines.len()),
        (Some(1), 3),
        "{}",
        garbage.log
    );
    assert!(
        garbage.log.contains("no frame was usable"),
        "{}",
        garbage.log
    );
    assert!(garbage.log.contains("empty 3"), "{}", garbage.log);
    let scans = clean_folder(folder.path(), 1);
    std::fs::copy(input.join("nan.bin"), scans.join("garbage.bin")).unwrap();
    let mixed = run("mixed", &scans);
    assert_eq!(mixed.code, Some(0), "{}", mixed.log);
}
