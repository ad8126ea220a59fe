//! Triangles with a surface each, and primitives for building parts.

use super::random::Dice;

pub(crate) use parry3d::math::Vector as V3;

/// The effect of a surface on a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Kind {
    /// Returns the ray.
    Solid,
    /// Window: passes most rays.
    Glass,
    /// Foliage, wire mesh, spokes: passes a ray with this probability.
    Porous(f32),
}

/// Reflectivity and kind of a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Surface {
    /// Share of the light that is reflected at normal incidence, 0..1.
    pub(crate) rho: f32,
    pub(crate) kind: Kind,
}

const fn surface(rho: f32, kind: Kind) -> Surface {
    Surface { rho, kind }
}

pub(crate) const fn solid(rho: f32) -> Surface {
    surface(rho, Kind::Solid)
}

/// A porous surface that this share of the rays passes.
pub(crate) const fn porous(rho: f32, passes: f32) -> Surface {
    surface(rho, Kind::Porous(passes))
}

pub(crate) const GLASS: Surface = surface(0.2, Kind::Glass);
/// Tyres.
pub(crate) const RUBBER: Surface = solid(0.07);
/// Bare or galvanised metal.
pub(crate) const METAL: Surface = solid(0.35);
/// Seats and dashboards.
pub(crate) const INTERIOR: Surface = solid(0.12);
/// Number plates, signs, reflective strips.
pub(crate) const RETRO: Surface = solid(0.97);
/// Foliage.
pub(crate) const LEAVES: Surface = porous(0.35, 0.5);
/// Faces and hands.
pub(crate) const SKIN: Surface = solid(0.45);

/// A triangle soup; `surfaces[i]` belongs to `triangles[i]`.
#[derive(Clone, Debug, Default)]
pub(crate) struct Mesh {
    pub(crate) vertices: Vec<V3>,
    pub(crate) triangles: Vec<[u32; 3]>,
    pub(crate) surfaces: Vec<Surface>,
}

/// Short form for a point.
pub(crate) fn v(x: f32, y: f32, z: f32) -> V3 {
    V3::new(x, y, z)
}

/// A point above the origin.
pub(crate) fn up(z: f32) -> V3 {
    v(0.0, 0.0, z)
}

/// Points around a circle, placed by the cosine and sine of their angle; the first is offset by `phase` steps.
pub(crate) fn circle(sides: usize, phase: f32, mut place: impl FnMut(f32, f32) -> V3) -> Vec<V3> {
    (0..sides)
        .map(|i| (std::f32::consts::TAU * (i as f32 + phase) / sides as f32).sin_cos())
        .map(|(sin, cos)| place(cos, sin))
        .collect()
}

/// A ring from its left half: these points, then their mirror images on the right, in reverse order.
pub(crate) fn mirrored(left: &[V3]) -> Vec<V3> {
    let right = left.iter().rev().map(|p| v(p.x, -p.y, p.z));
    left.iter().copied().chain(right).collect()
}

impl Mesh {
    /// One more vertex; returns its index.
    pub(crate) fn vertex(&mut self, point: V3) -> u32 {
        self.vertices.push(point);
        (self.vertices.len() - 1) as u32
    }

    /// A triangle over existing vertices.
    pub(crate) fn face(&mut self, triangle: [u32; 3], surface: Surface) {
        self.triangles.push(triangle);
        self.surfaces.push(surface);
    }

    /// A quadrilateral, split along a-c.
    pub(crate) fn quad(&mut self, corners: [V3; 4], surface: Surface) {
        let [a, b, c, d] = corners.map(|p| self.vertex(p));
        self.face([a, b, c], surface);
        self.face([a, c, d], surface);
    }

    /// Surface between rings with the same number of points; `surface(ring, point)` chooses per quad.
    pub(crate) fn loft<R: AsRef<[V3]>>(
        &mut self,
        rings: &[R],
        closed: bool,
        surface: impl Fn(usize, usize) -> Surface,
    ) {
        let first = self.vertices.len() as u32;
        let count = rings.first().map_or(0, |ring| ring.as_ref().len());
        for ring in rings {
            self.vertices.extend_from_slice(ring.as_ref());
        }
        let at = |ring: usize, point: usize| first + (ring * count + point % count) as u32;
        for r in 1..rings.len() {
            for i in 0..count - usize::from(!closed) {
                let [a, b, c, d] = [at(r - 1, i), at(r - 1, i + 1), at(r, i + 1), at(r, i)];
                self.face([a, b, c], surface(r - 1, i));
                self.face([a, c, d], surface(r - 1, i));
            }
        }
    }

    /// A flat lid over a ring: a fan around its middle.
    pub(crate) fn cap(&mut self, ring: &[V3], surface: Surface) {
        let middle = self.vertex(ring.iter().copied().sum::<V3>() / ring.len() as f32);
        let first = self.vertices.len() as u32;
        self.vertices.extend_from_slice(ring);
        let count = ring.len() as u32;
        for i in 0..count {
            self.face([middle, first + i, first + (i + 1) % count], surface);
        }
    }

    /// An axis-aligned block.
    pub(crate) fn block(&mut self, center: V3, size: V3, surface: Surface) {
        self.tapered(center, size, [1.0, 1.0], surface);
    }

    /// A block whose top is scaled by these factors along x and y.
    pub(crate) fn tapered(&mut self, center: V3, size: V3, top: [f32; 2], surface: Surface) {
        let h = size / 2.0;
        let corners = [(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)];
        let ring = |z: f32, [sx, sy]: [f32; 2]| {
            corners.map(|(x, y)| center + v(x * h.x * sx, y * h.y * sy, z))
        };
        let rings = [ring(-h.z, [1.0, 1.0]), ring(h.z, top)];
        self.loft(&rings, true, |_, _| surface);
        for ring in rings {
            self.quad(ring, surface);
        }
    }

    /// Two blocks, to the right (-y) and to the left of the middle.
    pub(crate) fn twins(&mut self, center: V3, size: V3, surface: Surface) {
        for side in [-1.0, 1.0] {
            self.block(center * v(1.0, side, 1.0), size, surface);
        }
    }

    /// A rectangle across y, from the first to the second x and z.
    pub(crate) fn pane(&mut self, x: [f32; 2], y: f32, z: [f32; 2], surface: Surface) {
        let corners = [(0, 0), (1, 0), (1, 1), (0, 1)];
        self.quad(corners.map(|(i, j)| v(x[i], y, z[j])), surface);
    }

    /// A tapered tube between two points with lids.
    pub(crate) fn tube(&mut self, ends: [V3; 2], radii: [f32; 2], sides: usize, surface: Surface) {
        let axis = ends[1] - ends[0];
        if axis.length_squared() < 1e-8 {
            return;
        }
        let axis = axis.normalize();
        let helper = if axis.z.abs() < 0.8 { V3::Z } else { V3::X };
        let x = axis.cross(helper).normalize();
        let y = axis.cross(x);
        let rings = [0, 1]
            .map(|end| circle(sides, 0.0, |cos, sin| ends[end] + (x * cos + y * sin) * radii[end]));
        self.loft(&rings, true, |_, _| surface);
        for (ring, radius) in rings.iter().zip(radii) {
            if radius > 0.02 {
                self.cap(ring, surface);
            }
        }
    }

    /// A tube of one radius.
    pub(crate) fn rod(&mut self, ends: [V3; 2], radius: f32, sides: usize, surface: Surface) {
        self.tube(ends, [radius, radius], sides, surface);
    }

    /// A thin strut.
    pub(crate) fn strut(&mut self, from: V3, to: V3, radius: f32, surface: Surface) {
        self.rod([from, to], radius, 4, surface);
    }

    /// A surface over closed rings with a lid at both ends.
    pub(crate) fn hull<R: AsRef<[V3]>>(&mut self, rings: &[R], surface: Surface) {
        self.loft(rings, true, |_, _| surface);
        for ring in [rings.first(), rings.last()].into_iter().flatten() {
            self.cap(ring.as_ref(), surface);
        }
    }

    /// Stacked ellipses along z: (z, centre x, half x, half y) from bottom to top, with lids.
    pub(crate) fn stack<const N: usize>(&mut self, levels: [[f32; 4]; N], surface: Surface) {
        let place =
            |[z, x, rx, ry]: [f32; 4]| move |cos: f32, sin: f32| v(x + rx * cos, ry * sin, z);
        self.hull(&levels.map(|level| circle(8, 0.5, place(level))), surface);
    }

    /// An ellipsoid of stacked rings; each vertex moves in or out by up to `rough` of its radius.
    pub(crate) fn blob(
        &mut self,
        center: V3,
        radii: V3,
        (levels, sides): (usize, usize),
        rough: f32,
        dice: &mut Dice,
        surface: Surface,
    ) {
        let ring = |level: usize| {
            let t = (level as f32 + 0.5) / levels as f32;
            let (sin, cos) = ((t - 0.5) * std::f32::consts::PI).sin_cos();
            circle(sides, 0.0, |c, s| {
                let scale = 1.0 + dice.spread(rough);
                center + v(radii.x * cos * c, radii.y * cos * s, radii.z * sin) * scale
            })
        };
        let rings: Vec<Vec<V3>> = (0..levels).map(ring).collect();
        self.hull(&rings, surface);
    }

    /// Adds another mesh, each vertex moved by `place`.
    pub(crate) fn add(&mut self, other: &Mesh, place: impl Fn(V3) -> V3) {
        let first = self.vertices.len() as u32;
        let moved = other.triangles.iter().map(|t| t.map(|i| i + first));
        self.triangles.extend(moved);
        self.vertices.extend(other.vertices.iter().map(|p| place(*p)));
        self.surfaces.extend_from_slice(&other.surfaces);
    }

    pub(crate) fn map(&mut self, place: impl Fn(V3) -> V3) {
        for p in &mut self.vertices {
            *p = place(*p);
        }
    }

    /// Keeps the triangles whose middle satisfies `wanted`, and only the vertices that they need.
    pub(crate) fn keep(&mut self, wanted: impl Fn(V3) -> bool) {
        let mut kept = Mesh::default();
        for (triangle, surface) in self.triangles.iter().zip(&self.surfaces) {
            let corners = triangle.map(|i| self.vertices[i as usize]);
            if wanted((corners[0] + corners[1] + corners[2]) / 3.0) {
                let triangle = corners.map(|p| kept.vertex(p));
                kept.face(triangle, *surface);
            }
        }
        *self = kept;
    }

    /// Moves every vertex by up to `amount_m` along each axis, so that no surface is a perfect plane.
    pub(crate) fn roughen(&mut self, amount_m: f32, dice: &mut Dice) {
        let range = [-amount_m, amount_m];
        for p in &mut self.vertices {
            *p += dice.size(range, range, range);
        }
    }

    /// Lowest and highest corner; both zero when the mesh is empty.
    pub(crate) fn bounds(&self) -> (V3, V3) {
        let first = self.vertices.first().copied().unwrap_or_default();
        let grow = |(low, high): (V3, V3), p: &V3| (low.min(*p), high.max(*p));
        self.vertices.iter().fold((first, first), grow)
    }

    /// Scales to exactly these extents; the lowest point is on the ground and the middle above the origin.
    pub(crate) fn fit(&mut self, size_m: V3) {
        let (low, high) = self.bounds();
        let scale = size_m / (high - low).max(V3::splat(1e-3));
        let middle = (low + high) / 2.0;
        self.map(|p| (p - v(middle.x, middle.y, low.z)) * scale);
    }

    /// Moves the lowest point to the ground.
    pub(crate) fn put_down(&mut self) {
        let low = self.bounds().0.z;
        self.map(|p| v(p.x, p.y, p.z - low));
    }
}
