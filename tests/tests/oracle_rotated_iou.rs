//! Compares rotated IoU with a polygon library's answers in f64.

use mluc_geometry::{Box3, iou_3d, iou_bev};
use mluc_tests::{oracle, read_json};

#[test]
fn oracle_rotated_iou_agrees_within_1e_6() {
    let Some(folder) = oracle() else { return };
    let answer = read_json(&folder.join("rotated_iou.json"));
    let pairs = answer["pairs"].as_array().expect("pairs");
    assert!(!pairs.is_empty(), "no pairs");
    let mut worst = 0.0f64;
    for (i, pair) in pairs.iter().enumerate() {
        let numbers = |name: &str| serde_json::from_value(pair[name].clone());
        let [a, b] = ["a", "b"].map(|name| Box3::new(numbers(name).expect("seven numbers")));
        for (name, found) in [("iou_bev", iou_bev(&a, &b)), ("iou_3d", iou_3d(&a, &b))] {
            let expected = pair[name].as_f64().expect("a number");
            let difference = (found - expected).abs();
            worst = worst.max(difference);
            assert!(difference <= 1e-6, "pair {i}, {name}: expected {expected}, found {found}");
        }
    }
    println!("{} pairs, worst difference {worst:e}", pairs.len());
}
