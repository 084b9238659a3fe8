//! Turntables: views all around a point.

use std::f64::consts::TAU;

use glam::{DMat3, DMat4, DVec3};

use super::file::{CameraFile, Matrix, SceneFile};
use super::readers::LARGEST;
use crate::base::{Error, Result};

/// Most views.
pub const MOST: u32 = 10_000;

/// How far, as a sine, an axis may be from level with the picture's rows.
const LEVEL: f64 = 1e-3;

/// Replaces the scene's cameras by `count` views that its default camera has when it goes around the vertical axis through `point`,
/// anticlockwise as seen from above, in equal steps; it stays as far and as high. The first view is the camera as it is. They are
/// named by their numbers from 0 on, with leading zeros.
///
/// # Errors
/// [`Error::Options`] for a point beyond the largest coordinate of scenes.
pub fn orbit(file: &mut SceneFile, count: u32, point: DVec3) -> Result<()> {
    if point.abs().max_element() > f64::from(LARGEST) {
        return Err(Error::Options(format!("--around: a coordinate is beyond the limit, {LARGEST:e}")));
    }
    let digits = count.saturating_sub(1).to_string().len().max(3);
    let to_world = matrix(&file.camera.to_world);
    let up = up(&to_world);
    let view = |number: u32| {
        let angle = TAU * f64::from(number) / f64::from(count);
        let turn = DMat4::from_mat3(DMat3::from_axis_angle(up, angle));
        let turned = DMat4::from_translation(point) * turn * DMat4::from_translation(-point) * to_world;
        let to_world = turned.transpose().to_cols_array().map(|value| value as f32);
        (format!("{number:0digits$}"), CameraFile { to_world, ..file.camera.clone() })
    };
    let views = (1..count).map(view).collect();
    (file.camera_name, file.cameras) = (format!("{:0digits$}", 0), views);
    Ok(())
}

/// The point on the viewing axis of `camera` that is nearest to the middle of a box.
///
/// # Errors
/// [`Error::Options`] where there is no box, or where its middle is not in front of the camera.
pub fn ahead(camera: &CameraFile, [low, high]: [DVec3; 2]) -> Result<DVec3> {
    let refused =
        |why: &str| Error::Options(format!("--orbit: {why}; give the point to go around with --around X,Y,Z"));
    if !(low.is_finite() && high.is_finite()) {
        return Err(refused("there is nothing to go around"));
    }
    let to_world = matrix(&camera.to_world);
    let (eye, axis) = (to_world.w_axis.truncate(), to_world.z_axis.truncate().normalize_or(DVec3::Z));
    let distance = (0.5 * (low + high) - eye).dot(axis);
    match distance > 0.0 {
        true => Ok(eye + distance * axis),
        false => Err(refused("the middle of the scene is not in front of the camera")),
    }
}

fn matrix(matrix: &Matrix) -> DMat4 {
    DMat4::from_cols_array(&matrix.map(f64::from)).transpose()
}

/// The direction along an axis of the world that is nearest to a camera's up, of those that the rows of its picture are level to, if
/// there are any: a camera that looks steeply down is turned about the vertical all the same.
fn up(to_world: &DMat4) -> DVec3 {
    let [across, up] = [to_world.x_axis, to_world.y_axis].map(|axis| axis.truncate().normalize_or_zero());
    let axes = DVec3::AXES.into_iter().flat_map(|axis| [axis, -axis]);
    let level = |axis: &DVec3| axis.dot(across).abs() < LEVEL;
    let any = axes.clone().any(|axis| level(&axis) && axis.dot(up) > LEVEL);
    let nearest = |a: &DVec3, b: &DVec3| a.dot(up).total_cmp(&b.dot(up));
    axes.filter(|axis| !any || level(axis)).max_by(nearest).unwrap_or(DVec3::Y)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::file::{FilmFile, FilterFile, IDENTITY};

    /// A camera at `eye` that looks at `target`, level to `up`.
    fn looking(eye: DVec3, target: DVec3, up: DVec3) -> CameraFile {
        let z = (target - eye).normalize();
        let x = up.cross(z).normalize();
        let frame = DMat4::from_cols(x.extend(0.0), z.cross(x).extend(0.0), z.extend(0.0), eye.extend(1.0));
        CameraFile::pinhole(frame.transpose().to_cols_array().map(|value| value as f32), 40.0)
    }

    fn turned(camera: CameraFile, count: u32, point: DVec3) -> Vec<(String, CameraFile)> {
        let film = FilmFile { width: 1, height: 1, filter: FilterFile::default() };
        let mut file = SceneFile::empty(String::new(), camera, film);
        orbit(&mut file, count, point).expect("the point is near");
        file.views().map(|(name, camera)| (name.to_owned(), camera.clone())).collect()
    }

    /// All views look at the point, as far from it and as high as the camera, which is the first one; halfway the view is that from the
    /// other side.
    #[test]
    fn views_go_around_the_point() {
        let (eye, point) = (DVec3::new(1.0, 3.0, -4.0), DVec3::new(2.0, 1.0, 1.0));
        let camera = looking(eye, point, DVec3::Y);
        let views = turned(camera.clone(), 8, point);
        assert_eq!((views[0].0.as_str(), views[7].0.as_str(), views.len()), ("000", "007", 8));
        assert_eq!(views[0].1, camera);
        for (name, view) in &views {
            let to_world = matrix(&view.to_world);
            let [_, y, z, eye_now] =
                [to_world.x_axis, to_world.y_axis, to_world.z_axis, to_world.w_axis].map(|a| a.truncate());
            assert!((eye_now.distance(point) - eye.distance(point)).abs() < 1e-5 && (eye_now.y - eye.y).abs() < 1e-6);
            assert!(z.normalize().dot((point - eye_now).normalize()) > 1.0 - 1e-9 && y.y > 0.0, "{name}");
        }
        let across = matrix(&views[4].1.to_world).w_axis.truncate();
        assert!(across.distance(DVec3::new(2.0 * point.x - eye.x, eye.y, 2.0 * point.z - eye.z)) < 1e-5, "{across}");
        // Anticlockwise from above: from +z to +x.
        let quarter = &turned(looking(DVec3::Z, DVec3::ZERO, DVec3::Y), 4, DVec3::ZERO)[1].1;
        assert!(matrix(&quarter.to_world).w_axis.truncate().distance(DVec3::X) < 1e-6);
        assert_eq!(turned(camera, 1234, point)[1233].0, "1233");
    }

    #[test]
    fn up_is_an_axis_of_the_world() {
        let up_of = |eye: DVec3, axis: DVec3| up(&matrix(&looking(eye, DVec3::ZERO, axis).to_world));
        for axis in [DVec3::Y, DVec3::Z, DVec3::NEG_Y, DVec3::X] {
            let aside = DVec3::new(0.7, 0.3, 0.5).cross(axis).normalize();
            for height in [-1.5, 0.0, 0.2, 3.0] {
                assert_eq!(up_of(aside + height * axis, axis), axis, "{axis} from {height}");
            }
        }
        // Nothing is level: the nearest.
        assert_eq!(up_of(DVec3::Z, DVec3::new(0.3, 1.0, 0.0)), DVec3::Y);
    }

    #[test]
    fn the_middle_is_ahead() {
        let camera = looking(DVec3::new(0.0, 1.0, 5.0), DVec3::new(0.0, 1.0, 0.0), DVec3::Y);
        let middle = ahead(&camera, [DVec3::new(-1.0, -1.0, -1.0), DVec3::ONE]).unwrap();
        assert!(middle.distance(DVec3::Y) < 1e-6, "the point of the axis that is nearest to the origin: {middle}");
        let behind = ahead(&camera, [DVec3::splat(6.0), DVec3::splat(7.0)]).unwrap_err().to_string();
        assert!(behind.contains("in front of") && behind.contains("--around"), "{behind}");
        assert!(ahead(&CameraFile::pinhole(IDENTITY, 40.0), [DVec3::INFINITY, DVec3::NEG_INFINITY]).is_err());
    }
}
