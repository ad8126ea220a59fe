//! One frame as one triangle mesh, with the surface and the instance of every triangle.

use super::mesh::{Mesh, Surface, V3, v};
use super::{Class, ground::Ground, layout::Placed};
use mluc_geometry::{Box3, limit_period};
use parry3d::shape::TriMesh;
use std::ops::Range;

/// Triangles of a frame.
#[derive(Default)]
pub(crate) struct Scene {
    pub(crate) mesh: Mesh,
    pub(crate) instances: Vec<u16>,
    /// Intensity of the rain, 0..1.
    pub(crate) rain: f32,
}

/// A labelled object in the scene.
pub(crate) struct Solid {
    pub(crate) class: Class,
    pub(crate) box_in_sensor: Box3,
    /// Its triangles in the scene.
    pub(crate) faces: Range<usize>,
    /// Its vertices in the scene.
    pub(crate) vertices: Range<usize>,
}

impl Scene {
    /// Adds a mesh, each vertex moved by `place`.
    pub(crate) fn add(&mut self, mesh: &Mesh, instance: u16, place: impl Fn(V3) -> V3) {
        self.mesh.add(mesh, place);
        self.instances.resize(self.mesh.triangles.len(), instance);
    }

    /// Adds the labelled objects, instances from 1 in order. They stand on the ground and follow its slope (sheared, so that the label stays upright).
    pub(crate) fn add_objects(&mut self, ground: &Ground, placed: &[Placed]) -> Vec<Solid> {
        let mut add = |(index, object): (usize, &Placed)| {
            let (first_face, first_vertex) = (self.mesh.triangles.len(), self.mesh.vertices.len());
            let (at, model) = (object.footprint, &object.model);
            let base = ground.height(at.x, at.y);
            let (gx, gy) = ground.gradient(at.x, at.y);
            let middle = (model.low + model.high) / 2.0;
            let (sin, cos) = at.yaw.sin_cos();
            self.add(&model.mesh, (index + 1) as u16, |p| {
                let (lx, ly) = (p.x - middle.x, p.y - middle.y);
                let (dx, dy) = (lx * cos - ly * sin, lx * sin + ly * cos);
                v(at.x + dx, at.y + dy, base + p.z + gx * dx + gy * dy)
            });
            let yaw_rad = limit_period(f64::from(at.yaw), 0.5, std::f64::consts::TAU);
            Solid {
                class: object.class,
                box_in_sensor: Box3 {
                    center_m: [at.x, at.y, base + middle.z].map(f64::from),
                    size_m: model.size_m().to_array().map(f64::from),
                    yaw_rad,
                },
                faces: first_face..self.mesh.triangles.len(),
                vertices: first_vertex..self.mesh.vertices.len(),
            }
        };
        placed.iter().enumerate().map(&mut add).collect()
    }

    /// Moves everything to the sensor frame at `sensor_at`; the sensor was at the origin.
    pub(crate) fn see_from(&mut self, sensor_at: V3, solids: &mut [Solid]) {
        for vertex in &mut self.mesh.vertices {
            *vertex -= sensor_at;
        }
        let moved = sensor_at.to_array().map(f64::from);
        for solid in solids {
            for (axis, moved) in moved.iter().enumerate() {
                solid.box_in_sensor.center_m[axis] -= moved;
            }
        }
    }

    /// All triangles, or the triangles of one object, prepared for ray casting.
    pub(crate) fn searchable(&self, faces: Range<usize>) -> Result<Searchable<'_>, String> {
        let triangles = &self.mesh.triangles[faces.clone()];
        let used = triangles.iter().flatten().copied();
        let low = used.clone().min().unwrap_or(0);
        let high = used.max().map_or(0, |i| i + 1);
        let vertices = self.mesh.vertices[low as usize..high as usize].to_vec();
        let triangles = triangles.iter().map(|t| t.map(|i| i - low)).collect();
        let mesh = TriMesh::new(vertices, triangles).map_err(|e| e.to_string())?;
        Ok(Searchable {
            mesh,
            surfaces: &self.mesh.surfaces[faces.clone()],
            instances: &self.instances[faces],
        })
    }
}

/// A mesh prepared for ray casting.
pub(crate) struct Searchable<'a> {
    pub(crate) mesh: TriMesh,
    pub(crate) surfaces: &'a [Surface],
    pub(crate) instances: &'a [u16],
}
