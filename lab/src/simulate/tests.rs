use super::*;

#[test]
fn the_same_key_gives_the_same_frame() {
    let a = frame(Family::SimKitti, Split::Val, 7, 3).expect("a frame");
    assert_eq!(
        a,
        frame(Family::SimKitti, Split::Val, 7, 3).expect("a frame")
    );
    assert_ne!(
        a.points,
        frame(Family::SimKitti, Split::Test, 7, 3)
            .expect("a frame")
            .points
    );
}
