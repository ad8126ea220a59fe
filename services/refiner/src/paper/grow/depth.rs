//! Algorithm 1 with the sign of depth clustering (Bogoslavskyi and Stachniss, 2016), on a range image.
//!
//! A neighbour joins when the angle is *above* 10 degrees: the surface continues. Neighbours lie in the eight directions of a range image; a few
//! empty pixels are skipped, because missing returns split dark cars. Row: the nearest of the model's beams; column: azimuth divided by the sensor's
//! step. The nearest return represents its pixel, and returns just behind it join with it. Pixels of the ground stop a direction. Without a beam
//! table, neighbours are found within a distance that grows with range.

use super::{Grower, Growth};
use crate::{paper::angle::is_above, paper::buckets::Buckets, paper::neighbourhood::Neighbourhood};
use mluc_model::Beams;

const EMPTY: u32 = u32::MAX;
/// Points are joined when the angle is above this, degrees. On real scans 10 keeps 94 % of the pairs on one object and joins
/// 1 % across a border; 25 is the complement of the printed 65.
const ANGLE_MIN_DEG: f64 = 10.0;
/// Number of empty pixels that are skipped in each direction of the range image: otherwise missing returns split cars.
const GAP_PIXELS: isize = 2;
/// Without a beam table, neighbours are closer than this, m, plus an increase with range.
const FALLBACK_M: f32 = 0.3;
/// The increase of this distance, m per m of range.
const FALLBACK_PER_RANGE: f32 = 0.01;
/// Returns of one pixel belong together if their ranges differ by at most this, m: two beams can fall into one row of the model's table.
const SAME_PIXEL_M: f32 = 0.5;

/// Depth clustering grown from a seed.
#[derive(Debug)]
pub struct Depth {
    image: Option<Image>,
    buckets: Buckets,
}

/// The range image of one neighbourhood.
#[derive(Debug, Default)]
struct Image {
    /// Tangents of the elevations between two beams, from the top down.
    borders: Vec<f32>,
    columns: usize,
    step_rad: f32,
    /// Point of each pixel, row by row; emptied after use.
    pixels: Vec<u32>,
    pixel_of: Vec<u32>,
    /// The next point in the same pixel.
    next_in_pixel: Vec<u32>,
    range_m: Vec<f32>,
    is_joined: Vec<bool>,
}

impl Depth {
    /// A grower for the model's beams; `None`: neighbours are found by distance.
    pub fn new(beams: Option<&Beams>) -> Depth {
        Depth { image: beams.map(Image::new), buckets: Buckets::default() }
    }
}

impl Grower for Depth {
    fn grow(&mut self, growth: &Growth, members: &mut Vec<u32>) {
        let around = growth.around;
        if let Some(image) = &mut self.image {
            image.draw(around);
            image.grow(growth, members);
            return image.wipe();
        }
        let reach = |t: usize| {
            let [x, y, _] = around.in_sensor_m(t);
            FALLBACK_M + FALLBACK_PER_RANGE * x.hypot(y) as f32
        };
        let farthest = (0..around.len()).map(reach).fold(FALLBACK_M, f32::max);
        growth.over_neighbours(&mut self.buckets, farthest, reach, |_, _| true, members);
    }
}

impl Image {
    fn new(beams: &Beams) -> Image {
        let columns = ((std::f32::consts::TAU / beams.azimuth_step_rad) as usize).max(1);
        let between = |pair: &[f32]| ((pair[0] + pair[1]) / 2.0).tan();
        Image {
            borders: beams.elevation_rad.windows(2).map(between).collect(),
            columns,
            step_rad: std::f32::consts::TAU / columns as f32,
            pixels: vec![EMPTY; columns * beams.elevation_rad.len().max(1)],
            ..Image::default()
        }
    }

    /// Puts every point into its pixel; each pixel's points form a list, the nearest first.
    fn draw(&mut self, around: &Neighbourhood) {
        self.pixel_of.clear();
        self.range_m.clear();
        self.next_in_pixel.clear();
        self.next_in_pixel.resize(around.len(), EMPTY);
        for i in 0..around.len() {
            let [x, y, z] = around.in_sensor_m(i).map(|v| v as f32);
            let flat = x.hypot(y);
            let row = self.borders.partition_point(|&border| border > z / flat);
            let turn = y.atan2(x).rem_euclid(std::f32::consts::TAU);
            let column = ((turn / self.step_rad) as usize).min(self.columns - 1);
            let pixel = row * self.columns + column;
            self.pixel_of.push(pixel as u32);
            self.range_m.push(flat.hypot(z));
            self.insert(around, pixel, i);
        }
    }

    /// Inserts a point: the nearest return is first, the others follow in any order. One step, for any number of points in the pixel.
    fn insert(&mut self, around: &Neighbourhood, pixel: usize, point: usize) {
        let head = self.pixels[pixel];
        let key = |i: usize| (self.range_m[i], around.x_m[i], around.y_m[i]);
        if head == EMPTY || key(point) < key(head as usize) {
            self.next_in_pixel[point] = head;
            self.pixels[pixel] = point as u32;
        } else {
            self.next_in_pixel[point] = self.next_in_pixel[head as usize];
            self.next_in_pixel[head as usize] = point as u32;
        }
    }

    fn wipe(&mut self) {
        for &pixel in &self.pixel_of {
            self.pixels[pixel as usize] = EMPTY;
        }
    }

    fn grow(&mut self, growth: &Growth, members: &mut Vec<u32>) {
        let angle_min_cosine = ANGLE_MIN_DEG.to_radians().cos() as f32;
        let point = |i: u32| growth.around.in_sensor_m(i as usize).map(|v| v as f32);
        members.clear();
        self.is_joined.clear();
        self.is_joined.resize(growth.around.len(), false);
        self.join(growth, growth.seed as u32, members);
        let mut next = 0;
        while let Some(&t) = members.get(next) {
            next += 1;
            for direction in directions() {
                if let Some(s) = self.neighbour(t as usize, direction)
                    && !self.is_joined[s as usize]
                    && growth.stands(s as usize)
                    && is_above(point(s), point(t), angle_min_cosine)
                {
                    self.join(growth, s, members);
                }
            }
        }
    }

    /// Joins the point, and the points of its pixel at about its range.
    fn join(&mut self, growth: &Growth, point: u32, members: &mut Vec<u32>) {
        let range = self.range_m[point as usize];
        self.is_joined[point as usize] = true;
        members.push(point);
        let mut current = self.pixels[self.pixel_of[point as usize] as usize];
        while current != EMPTY {
            let i = current as usize;
            let same = (self.range_m[i] - range).abs() <= SAME_PIXEL_M;
            if same && !self.is_joined[i] && growth.stands(i) {
                self.is_joined[i] = true;
                members.push(current);
            }
            current = self.next_in_pixel[i];
        }
    }

    /// The nearest return of the first pixel in a direction that is not empty; skips a few empty pixels.
    fn neighbour(&self, t: usize, (dr, dc): (isize, isize)) -> Option<u32> {
        let pixel = self.pixel_of[t] as usize;
        let (row, column) = (pixel / self.columns, pixel % self.columns);
        for step in 1..=GAP_PIXELS + 1 {
            let row = row.checked_add_signed(dr * step)?;
            if row > self.borders.len() {
                return None;
            }
            let column = (column as isize + dc * step).rem_euclid(self.columns as isize) as usize;
            let found = self.pixels[row * self.columns + column];
            if found != EMPTY {
                return Some(found);
            }
        }
        None
    }
}

/// The steps in rows and columns to the eight neighbours of a pixel.
fn directions() -> impl Iterator<Item = (isize, isize)> {
    let all = (-1..=1).flat_map(|row| (-1..=1).map(move |column| (row, column)));
    all.filter(|&direction| direction != (0, 0))
}
