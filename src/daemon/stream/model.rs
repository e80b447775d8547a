//! MODEL: the target's surface as it is known so far, thinned out for viewers.

use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_core::track::{Surfels, Tracker};
use tumbled_model::{RigNs, UnixNs};

use super::class::Class;
use super::cloud::to_millimetre;
use super::hello::StreamOrigin;

/// The target's surface after an epoch.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(title = "tumbled stream: MODEL")]
pub struct ModelLine {
    /// MODEL.
    pub class: Class,
    /// Where the data come from.
    pub origin: StreamOrigin,
    /// The target's number in the session: with another one it is another target, in a frame of its own.
    pub target: u32,
    /// The epoch it follows.
    pub epoch: u64,
    /// Its time, ns on the session's timeline.
    pub t_ns: i64,
    /// The same as wall time, ns since 1970-01-01 UTC as a decimal string.
    pub unix_ns: String,
    /// The frame of the coordinates: `target`. STATE tells where it lies in the rig.
    pub frame: String,
    /// Sensor frames in it.
    pub frames: u64,
    /// Pieces of surface before they were thinned out.
    pub surfels_total: u64,
    /// Every so many-th is here.
    pub decimation: u64,
    /// x, y, z, m, rounded to millimetres.
    pub xyz_m: Vec<[f32; 3]>,
    /// Of each the direction out of the body, of length 1, rounded to hundredths.
    pub normals: Vec<[f32; 3]>,
}

/// The model after an epoch: borrowed, not thinned out.
#[derive(Clone, Copy, Debug)]
pub struct ModelView<'a> {
    /// The target's number in the session.
    pub target: u32,
    /// The epoch it follows.
    pub epoch: u64,
    /// Its time.
    pub t: RigNs,
    /// The same as wall time.
    pub unix: UnixNs,
    /// Sensor frames in it.
    pub frames: usize,
    /// The surface, target's frame.
    pub surfels: &'a Surfels,
}

impl<'a> ModelView<'a> {
    /// Of a target, by its number in the session, after an epoch at `t`, wall time `unix`.
    pub fn new((target, tracker): (u32, &'a Tracker), epoch: u64, (t, unix): (RigNs, UnixNs)) -> Self {
        Self { target, epoch, t, unix, frames: tracker.insertions(), surfels: tracker.surfels() }
    }

    /// Every so many-th piece has to be taken for at most `max` of them; at least 1.
    pub fn decimation(&self, max: usize) -> usize {
        self.surfels.len().div_ceil(max.max(1)).max(1)
    }

    /// Place, m, and normal of every [`ModelView::decimation`]-th piece.
    pub fn thinned_out(&self, max: usize) -> impl Iterator<Item = ([f32; 3], [f32; 3])> + use<'a> {
        let rows = self.surfels.positions().iter().zip(self.surfels.normals());
        rows.step_by(self.decimation(max)).map(|(place, normal)| (single(&place.coords), single(normal)))
    }
}

impl ModelLine {
    /// The line of a model with at most `max` pieces of it.
    pub fn new(origin: StreamOrigin, model: &ModelView<'_>, max: usize) -> Self {
        let thinned_out = model.thinned_out(max);
        let (xyz_m, normals): (Vec<_>, Vec<_>) =
            thinned_out.map(|(place, normal)| (place.map(to_millimetre), normal.map(to_hundredth))).unzip();
        Self {
            class: Class::Model,
            origin,
            target: model.target,
            epoch: model.epoch,
            t_ns: model.t.0,
            unix_ns: model.unix.0.to_string(),
            frame: "target".to_owned(),
            frames: model.frames as u64,
            surfels_total: model.surfels.len() as u64,
            decimation: model.decimation(max) as u64,
            xyz_m,
            normals,
        }
    }
}

fn single(vector: &Vector3<f64>) -> [f32; 3] {
    vector.cast::<f32>().into()
}

/// A direction to half a degree, in 4 or 5 characters instead of 10.
fn to_hundredth(part: f32) -> f32 {
    (part * 100.0).round() / 100.0
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;
    use tumbled_core::track::Surfel;

    use super::*;

    fn view(surfels: &Surfels) -> ModelView<'_> {
        ModelView { target: 2, epoch: 7, t: RigNs(5), unix: UnixNs(9), frames: 3, surfels }
    }

    fn row(count: usize) -> Surfels {
        let normal = Vector3::new(0.0, 0.6, 0.8);
        Surfels::of((0..count).map(|n| Surfel {
            position: Point3::new(n as f64, 0.000_4, 1.234_56),
            normal,
            weight: 1e4,
        }))
    }

    #[test]
    fn every_kth_piece_is_told_in_millimetres_with_its_normal() {
        let surfels = row(5);
        // 5 pieces, at most 2: every third (ceil 5/2), that is 0 and 3.
        let line = serde_json::to_string(&ModelLine::new(StreamOrigin::Live, &view(&surfels), 2)).expect("JSON");
        assert_eq!(
            line,
            r#"{"class":"MODEL","origin":"live","target":2,"epoch":7,"t_ns":5,"unix_ns":"9","frame":"target","#
                .to_owned()
                + r#""frames":3,"surfels_total":5,"decimation":3,"xyz_m":[[0.0,0.0,1.235],[3.0,0.0,1.235]],"#
                + r#""normals":[[0.0,0.6,0.8],[0.0,0.6,0.8]]}"#
        );
    }

    #[test]
    fn a_line_of_the_default_size_is_less_than_a_hundred_kilobytes() {
        // 2 000 rows of three 6-character and three 5-character numbers, commas and brackets: 2 000 × (18 + 15 + 10).
        let normal = Vector3::new(-0.577, -0.577, -0.577);
        let far = |n: usize| Surfel { position: Point3::new(-1.234, -2.345, -1e-4 * n as f64), normal, weight: 1.0 };
        let surfels = Surfels::of((0..60_000).map(far));
        let line = ModelLine::new(StreamOrigin::Live, &view(&surfels), 2_000);
        let bytes = serde_json::to_string(&line).expect("JSON").len();
        assert!(line.xyz_m.len() == 2_000 && bytes < 100_000, "{} pieces, {bytes} bytes", line.xyz_m.len());
    }
}
