//! Oriented boxes that stand upright.

/// A box in the sensor frame: geometric centre, size along heading (l), across (w) and up (h), yaw about +z.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Box3 {
    /// x, y, z of the geometric centre, m.
    pub center_m: [f64; 3],
    /// l, w, h, m.
    pub size_m: [f64; 3],
    /// Heading, rad, counter-clockwise from +x.
    pub yaw_rad: f64,
}

impl Box3 {
    /// From x, y, z, l, w, h, yaw.
    pub fn new(v: [f64; 7]) -> Box3 {
        Box3 { center_m: [v[0], v[1], v[2]], size_m: [v[3], v[4], v[5]], yaw_rad: v[6] }
    }

    /// From the f32 numbers of a message: centre and size, m; yaw, rad.
    pub fn from_f32(center_m: [f32; 3], size_m: [f32; 3], yaw_rad: f32) -> Box3 {
        Box3 {
            center_m: center_m.map(f64::from),
            size_m: size_m.map(f64::from),
            yaw_rad: f64::from(yaw_rad),
        }
    }

    /// Corners of the footprint, counter-clockwise, m: front left, rear left, rear right, front right.
    pub fn footprint_m(&self) -> [[f64; 2]; 4] {
        let (sin, cos) = self.yaw_rad.sin_cos();
        let ([l, w, _], [x, y, _]) = (self.size_m, self.center_m);
        [[0.5, 0.5], [-0.5, 0.5], [-0.5, -0.5], [0.5, -0.5]].map(|[u, v]| {
            let (u, v) = (u * l, v * w);
            [x + u * cos - v * sin, y + u * sin + v * cos]
        })
    }

    /// Volume, m^3; 0 when a size is not positive.
    pub fn volume_m3(&self) -> f64 {
        self.size_m.iter().map(|s| s.max(0.0)).product()
    }

    /// A point in the box's own frame: along heading, across, up from the centre, m.
    pub fn local_m(&self, point_m: [f64; 3]) -> [f64; 3] {
        let (sin, cos) = self.yaw_rad.sin_cos();
        let [dx, dy, dz] = [0, 1, 2].map(|i| point_m[i] - self.center_m[i]);
        [dx * cos + dy * sin, dy * cos - dx * sin, dz]
    }

    /// Half the diagonal of the footprint, m: the radius of the circle around it.
    pub fn half_diagonal_m(&self) -> f64 {
        self.size_m[0].hypot(self.size_m[1]) / 2.0
    }

    /// Whether a point lies inside or on the surface.
    pub fn contains(&self, point_m: [f64; 3]) -> bool {
        Inside::of(self, 0.0).contains(point_m)
    }

    /// [`Box3::contains`] for a scan's point: x, y, z (m), intensity.
    pub fn has_point(&self, point: &[f32; 4]) -> bool {
        Inside::of(self, 0.0).has_point(point)
    }

    /// Number of a scan's points that lie inside.
    pub fn count_inside(&self, points: &[[f32; 4]]) -> usize {
        // The square around the footprint decides most points without the rotation.
        let (own, reach_m) = (Inside::of(self, 0.0), self.half_diagonal_m());
        let near = |p: &[f32; 4], i: usize| (f64::from(p[i]) - self.center_m[i]).abs() <= reach_m;
        let inside = |p: &&[f32; 4]| near(p, 0) && near(p, 1) && own.has_point(p);
        points.iter().filter(inside).count()
    }
}

/// A box prepared for many containment tests: the sine and cosine of its heading are computed once.
#[derive(Clone, Copy, Debug)]
pub struct Inside {
    center_m: [f64; 3],
    half_m: [f64; 3],
    sin: f64,
    cos: f64,
}

impl Inside {
    /// Prepares the box, enlarged by a margin on every side, m.
    #[inline]
    pub fn of(shape: &Box3, margin_m: f64) -> Inside {
        let (sin, cos) = shape.yaw_rad.sin_cos();
        Inside {
            center_m: shape.center_m,
            half_m: shape.size_m.map(|s| s / 2.0 + margin_m),
            sin,
            cos,
        }
    }

    /// Whether a point lies inside or on the surface; false for a point with a NaN coordinate.
    #[inline]
    pub fn contains(&self, point_m: [f64; 3]) -> bool {
        let [dx, dy, dz] = [0, 1, 2].map(|i| point_m[i] - self.center_m[i]);
        (dx * self.cos + dy * self.sin).abs() <= self.half_m[0]
            && (dy * self.cos - dx * self.sin).abs() <= self.half_m[1]
            && dz.abs() <= self.half_m[2]
    }

    /// [`Inside::contains`] for a scan's point: x, y, z (m), intensity.
    #[inline]
    pub fn has_point(&self, &[x, y, z, _]: &[f32; 4]) -> bool {
        self.contains([x, y, z].map(f64::from))
    }
}

/// The angle shifted by whole periods into `[-offset * period, (1 - offset) * period)`.
pub fn limit_period(value: f64, offset: f64, period: f64) -> f64 {
    value - (value / period + offset).floor() * period
}
