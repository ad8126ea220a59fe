//! Size of a frame's image, from the head of its PNG.

use crate::evaluate::EvaluateError;
use mluc_geometry::ImageSize;
use std::io::Read;
use std::path::Path;

/// Signature, length and type of the first chunk, width, height.
const HEAD_BYTES: usize = 24;

/// Size of `image_2/NAME.png` beside the folder of labels where it is present, else KITTI's.
pub(crate) fn size_beside(labels: &Path, name: &str) -> Result<ImageSize, EvaluateError> {
    let path = labels
        .join("..")
        .join("image_2")
        .join(format!("{name}.png"));
    if !path.is_file() {
        return Ok(ImageSize::KITTI);
    }
    png_size(&path)
}

fn png_size(path: &Path) -> Result<ImageSize, EvaluateError> {
    let mut head = [0u8; HEAD_BYTES];
    std::fs::File::open(path)
        .and_then(|mut file| file.read_exact(&mut head))
        .map_err(|source| EvaluateError::Read {
            path: path.to_owned(),
            source,
        })?;
    let number =
        |at: usize| u32::from_be_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]]);
    let size = ImageSize {
        width_px: number(16),
        height_px: number(20),
    };
    if !head.starts_with(b"\x89PNG\r\n\x1a\n")
        || &head[12..16] != b"IHDR"
        || size.width_px == 0
        || size.height_px == 0
    {
        return Err(EvaluateError::Image {
            path: path.to_owned(),
        });
    }
    Ok(size)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_size_comes_from_the_image_where_there_is_one() {
        let folder = tempfile::tempdir().expect("a folder");
        let (labels, images) = (folder.path().join("label_2"), folder.path().join("image_2"));
        std::fs::create_dir_all(&labels).expect("a folder");
        std::fs::create_dir_all(&images).expect("a folder");
        assert_eq!(
            size_beside(&labels, "0").expect("no image"),
            ImageSize::KITTI
        );
        let file = std::fs::File::create(images.join("0.png")).expect("a file");
        let mut writer = png::Encoder::new(file, 7, 5);
        writer.set_color(png::ColorType::Grayscale);
        writer
            .write_header()
            .and_then(|mut w| w.write_image_data(&[0; 35]))
            .expect("an image");
        assert_eq!(
            size_beside(&labels, "0").expect("an image"),
            ImageSize {
                width_px: 7,
                height_px: 5
            }
        );
        std::fs::write(images.join("1.png"), [0; 100]).expect("written");
        assert!(size_beside(&labels, "1").is_err());
    }
}
