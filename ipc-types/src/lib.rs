//! The contract: all data that passes between two processes, and nothing else.
//!
//! Every message is a slice of fixed-layout elements with one [`FrameHeader`]. Lengths in m, angles in rad, times in ns. A consumer trusts nothing that it
//! reads from shared memory: the `checked` functions turn a wrong version, length, index or enum value into a [`ContractError`], never a panic.

mod detection;
mod error;
mod features;
mod header;
mod health;
mod limits;
mod object;
mod point;
mod run;
mod services;
mod status;
mod text;

pub use detection::{Detection, DetectionKind, GateKind, NO_PROBABILITY};
pub use error::ContractError;
pub use features::{FeatureBlock, FeatureRows, feature_blocks};
pub use header::{EgoPose, Flags, FrameHeader, Stage, StageStamps};
pub use health::{CandidateCounts, Health, HealthState};
pub use limits::*;
pub use object::{Disposition, Object, ObjectKind, TrackNews};
pub use point::Point;
pub use run::RunDescription;
pub use services::Topic;
pub use status::{Status, StatusState};
pub use text::Text;

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    /// Checks a message of this many sound elements.
    type Check = fn(&FrameHeader, usize) -> error::Result<()>;

    #[test]
    fn what_is_beyond_the_limit_or_of_another_version_is_refused() {
        let checks: [(&str, usize, Check); 5] = [
            ("points", POINTS_MAX, |header, count| {
                Point::checked(header, &vec![Point::default(); count]).map(drop)
            }),
            ("feature channels", FEATURE_CHANNELS_MAX, |header, count| {
                let mut header = *header;
                header.feature_channels = count as u32;
                FeatureRows::checked(&header, &[], 400, count, 0).map(drop)
            }),
            ("detections", DETECTIONS_MAX, |header, count| {
                let mut sound = Detection::zeroed();
                sound.size_m = [1.0; 3];
                Detection::checked(header, &vec![sound; count], 1).map(drop)
            }),
            ("objects", OBJECTS_MAX, |header, count| {
                let mut sound = Object::zeroed();
                sound.disposition = Disposition::TooFewPoints as u32;
                sound.suppressed_by = Object::NONE;
                Object::checked(header, &vec![sound; count], 1).map(drop)
            }),
            ("object points", OBJECT_POINTS_MAX, |header, count| {
                Object::checked_points(header, &vec![0; count], 1).map(drop)
            }),
        ];
        for (what, limit, check) in checks {
            let mut header = FrameHeader::new(0, "a");
            assert_eq!(check(&header, limit), Ok(()), "{what}");
            let found = limit + 1;
            let error = check(&header, found).unwrap_err().to_string();
            let expected = format!("{what}: {found} exceeds the limit of {limit}");
            assert_eq!(error, expected);
            header.wire_version = 7;
            let error = check(&header, 0).unwrap_err().to_string();
            assert!(error.starts_with("wire version 7"), "{what}: {error}");
        }
    }
}
