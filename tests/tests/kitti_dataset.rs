//! Reads real KITTI folders: every frame in `MLUC_KITTI`.

use mluc_dataset::Dataset;
use mluc_geometry::{ImageSize, iou_2d};
use mluc_tests::data_folder;

/// Projected boxes of labels that lie wholly in the image must match the boxes that people drew there, and the
/// points of a near car must lie in its box: both are true only if every step of the conversion is right.
#[test]
fn real_labels_fall_on_their_image_boxes_and_points() {
    let Some(folder) = data_folder("MLUC_KITTI") else {
        return;
    };
    for part in ["object/training", "drive_0005"] {
        let dataset = Dataset::open(&folder.join(part)).expect("frames");
        let (mut overlap_sum, mut objects, mut near_cars, mut hit_cars) = (0.0, 0, 0, 0);
        for name in dataset.names() {
            let scan = dataset.scan(name).expect("a scan");
            let calibration = dataset.calibration(name).expect("a calibration");
            for (label, box_in_sensor) in dataset.boxes_in_sensor(name).expect("labels") {
                let label_again = calibration.label_from_box_in_sensor(&box_in_sensor);
                let seen = calibration.project_label_to_image(&label_again, ImageSize::KITTI);
                if let Some(seen) = seen.filter(|_| label.truncated == 0.0) {
                    overlap_sum += iou_2d(&seen, &label.image_box_px);
                    objects += 1;
                }
                let is_near = box_in_sensor.center_m[0] < 30.0 && label.occluded == 0;
                if is_near && (label.is("Car") || label.is("Van")) {
                    near_cars += 1;
                    hit_cars += usize::from(box_in_sensor.count_inside(&scan) >= 50);
                }
            }
        }
        let overlap = overlap_sum / f64::from(objects);
        println!(
            "{part}: mean image overlap {overlap:.3} of {objects}, {hit_cars} of {near_cars} near cars hit"
        );
        assert!(objects > 20 && overlap > 0.75);
        assert!(near_cars > 5 && hit_cars * 10 >= near_cars * 9);
    }
}
