//! The rules beyond names and types. They make a [`Config`] of a raw one, and go on after a problem.

use std::net::IpAddr;
use std::path::PathBuf;

use tumbled_model::{Frame, Iso, Point, Rig, Span};

use super::files::{FileFault, FileShelf, RigFile};
use super::layers::keys;
use super::origin::{Layer, Origin};
use super::problem::Problem;
use super::raw::{LidarModel, RawConfig, RawKinect, RawLidar, RawPointOfInterest, RawTransform, RawTurntable};
use super::tree::{Node, Step, display_path, element_path};
use super::{Config, KinectConfig, LidarConfig, PointOfInterest, SavedFile, TargetConfig, TurntableConfig};
use crate::target::SavedTarget;

/// Checks every rule and types what passes.
///
/// `tree` is what `raw` was read from, for the places; `faulty` the paths where something was taken out of it. `None`
/// only if a value could not be typed, with the reason among the problems; a config that breaks a rule between keys
/// is typed all the same, and the error keeps it from use.
pub(super) fn check_rules(
    raw: RawConfig,
    tree: &Node,
    faulty: &[Vec<Step>],
    shelf: &mut FileShelf,
    problems: &mut Vec<Problem>,
) -> Option<Config> {
    let mut rules = Rules { tree, faulty, shelf, problems };
    rules.not_empty(&keys(&["rig", "name"]), &raw.rig.name, "name the rig, e.g. name = \"lab-2\"");
    rules.ids(&raw);
    super::check_sensors::ports(&mut rules, &raw.lidar);
    super::check_sensors::serials(&mut rules, &raw.kinect);
    rules.point_names(&raw.points_of_interest);
    let lidars: Vec<_> = raw.lidar.into_iter().enumerate().map(|(i, lidar)| rules.lidar(i, lidar)).collect();
    let kinects: Vec<_> = raw.kinect.into_iter().enumerate().map(|(i, kinect)| rules.kinect(i, kinect)).collect();
    let turntable = raw.turntable.map(|turntable| rules.turntable(turntable));
    let time = super::check_session::time(&raw.time);
    let stream = super::check_session::stream(&mut rules, &raw.stream);
    let record = super::check_session::record(&mut rules, &raw.record);
    let saved = rules.saved(&raw.target.saved);
    let [x, y, z] = raw.target.roi_center_m;
    Some(Config {
        name: raw.rig.name,
        calibration: None,
        lidars: lidars.into_iter().collect::<Option<_>>()?,
        kinects: kinects.into_iter().collect::<Option<_>>()?,
        turntable,
        target: TargetConfig {
            roi_center: Point::new(x, y, z),
            roi_radius_m: raw.target.roi_radius_m,
            search: raw.target.search,
            background: raw.target.background,
            background_s: raw.target.background_s,
            saved: saved?,
        },
        points_of_interest: raw.points_of_interest.into_iter().map(typed_point).collect(),
        time,
        filter: raw.filter,
        stream: stream?,
        record: record?,
        limits: raw.limits,
    })
}

fn typed_point(raw: RawPointOfInterest) -> PointOfInterest {
    let [x, y, z] = raw.position_m;
    PointOfInterest { name: raw.name, position: Point::new(x, y, z) }
}

/// The rules' view of a config.
pub(super) struct Rules<'a> {
    tree: &'a Node,
    faulty: &'a [Vec<Step>],
    shelf: &'a mut FileShelf,
    problems: &'a mut Vec<Problem>,
}

impl Rules<'_> {
    /// Reports a broken rule at the value of a path.
    pub(super) fn broken(&mut self, path: &[Step], message: String, help: impl Into<String>) {
        let problem = Problem::error(self.tree.origin_at(path), Some(display_path(self.tree, path)), message);
        self.problems.push(problem.with_help(help));
    }

    fn warn(&mut self, path: &[Step], message: String, help: impl Into<String>) {
        let problem = Problem::warning(self.tree.origin_at(path), Some(display_path(self.tree, path)), message);
        self.problems.push(problem.with_help(help));
    }

    /// Whether the value of a path is what its author wrote (or left to the default), rather than a default put in
    /// the place of something faulty. Rules between several values only hold sound ones against each other.
    pub(super) fn sound(&self, path: &[Step]) -> bool {
        !self.faulty.iter().any(|faulty| {
            let removed = faulty.iter().rposition(|step| matches!(step, Step::Key(_))).map_or(0, |last| last + 1);
            faulty.get(..removed).is_some_and(|removed| path.starts_with(removed))
        })
    }

    fn not_empty(&mut self, path: &[Step], text: &str, help: &str) {
        if text.trim().is_empty() {
            self.broken(path, format!("`{}` is empty", display_path(self.tree, path)), help);
        }
    }

    /// Ids: letters that survive as file, topic and metric names; unique over all sensors; never a key's name, since
    /// `--set lidar.port=…` and `--set lidar.ID.key=…` must not be confused.
    fn ids(&mut self, raw: &RawConfig) {
        let lidars = raw.lidar.iter().enumerate().map(|(i, lidar)| (element_path("lidar", i, &["id"]), &lidar.id));
        let kinects = raw.kinect.iter().enumerate().map(|(i, k)| (element_path("kinect", i, &["id"]), &k.id));
        let mut seen: Vec<(&String, Vec<Step>)> = Vec::new();
        for (path, id) in lidars.chain(kinects) {
            if !self.sound(&path) {
                continue;
            }
            let allowed = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-' || c == '_';
            if id.is_empty() || !id.chars().all(allowed) {
                self.broken(&path, format!("\"{id}\" is not an id"), "an id is made of a-z, 0-9, - and _");
            } else if is_sensor_key(id) {
                let help = "choose another: --set could not tell the id from the key";
                self.broken(&path, format!("\"{id}\" cannot be an id: it is the name of a key"), help);
            } else if let Some((_, first)) = seen.iter().find(|(other, _)| *other == id) {
                let place = self.tree.origin_at(first).to_string();
                let help = format!("the first is at {place}; ids are unique over all LiDARs and Kinects");
                self.broken(&path, format!("\"{id}\" is the id of two sensors"), help);
            }
            seen.push((id, path));
        }
    }

    fn point_names(&mut self, points: &[RawPointOfInterest]) {
        for (index, point) in points.iter().enumerate() {
            let path = element_path("points_of_interest", index, &["name"]);
            self.not_empty(&path, &point.name, "name the point, e.g. name = \"grapple\"");
            if points.iter().take(index).any(|earlier| earlier.name == point.name) {
                let message = format!("\"{}\" is the name of two points of interest", point.name);
                self.broken(&path, message, "give each point a name of its own");
            }
        }
    }

    fn lidar(&mut self, index: usize, raw: RawLidar) -> Option<LidarConfig> {
        let at = |key: &str| element_path("lidar", index, &[key]);
        let source = self.address(&at("source"), raw.source.as_deref());
        let t_rig_lidar = self.transform(&at("t_rig_lidar"), &raw.t_rig_lidar);
        if let (Some(nearest), Some(farthest)) = (raw.range_min_m, raw.range_max_m)
            && nearest >= farthest
        {
            let message = format!("range_min_m = {nearest} is not below range_max_m = {farthest}");
            self.broken(&at("range_min_m"), message, "no point could pass: exchange or widen the two");
        }
        let calibration = self.hdl64e_calibration(&at("calibration"), raw.model, raw.calibration.as_deref());
        Some(LidarConfig {
            id: raw.id.into(),
            model: raw.model,
            port: raw.port,
            position_port: raw.position_port,
            source: source?,
            vertical_offsets: raw.vertical_offsets,
            calibration,
            t_rig_lidar: t_rig_lidar?,
            time_offset: span_of_ms(raw.time_offset_ms),
            sigma: raw.sigma,
            range_min_m: raw.range_min_m,
            range_max_m: raw.range_max_m,
            hdl32e_stamp: raw.hdl32e_stamp,
        })
    }

    /// The file is needed by an HDL-64E only, so only there its absence is an error.
    fn hdl64e_calibration(&mut self, path: &[Step], model: LidarModel, text: Option<&str>) -> Option<RigFile> {
        let text = text.filter(|text| !text.is_empty())?;
        if !matches!(model, LidarModel::Hdl64e | LidarModel::Auto) {
            self.shelf.note(text, self.tree.origin_at(path));
            let message = "the calibration file is not used: the model is not hdl-64e".to_owned();
            self.warn(path, message, "leave `calibration` out, or set model = \"hdl-64e\" or \"auto\"");
            return None;
        }
        match self.file(path, text) {
            Err(FileFault::Absent(message)) if model == LidarModel::Auto => {
                self.warn(path, message, "only an HDL-64E needs it: correct the path, or leave the key out");
                None
            }
            found => self.needed(path, found),
        }
    }

    fn kinect(&mut self, index: usize, raw: RawKinect) -> Option<KinectConfig> {
        let at = |key: &str| element_path("kinect", index, &[key]);
        let t_rig_kinect = self.transform(&at("t_rig_kinect"), &raw.t_rig_kinect);
        let depth_table = raw.depth_table.as_deref().filter(|text| !text.is_empty()).and_then(|text| {
            let found = self.file(&at("depth_table"), text);
            self.needed(&at("depth_table"), found)
        });
        if let Some(Err(error)) = raw.depth_warp.as_ref().map(|warp| tumbled_kinect::DepthWarp::from(warp).check()) {
            self.broken(&at("depth_warp"), error.to_string(), "take it from a calibration file, or leave it out");
            return None;
        }
        Some(KinectConfig {
            id: raw.id.into(),
            serial: Some(raw.serial).filter(|serial| !serial.is_empty()),
            intrinsics: raw.intrinsics,
            t_rig_kinect: t_rig_kinect?,
            time_offset: span_of_ms(raw.time_offset_ms),
            sigma: raw.sigma,
            depth_table,
            depth_scale: raw.depth_scale,
            depth_warp: raw.depth_warp,
        })
    }

    fn turntable(&mut self, raw: RawTurntable) -> TurntableConfig {
        let help = "name the serial device, e.g. port = \"/dev/rig/turntable\", or leave [turntable] out";
        self.not_empty(&keys(&["turntable", "port"]), &raw.port, help);
        let RawTurntable { port, protocol, baud, counts_per_turn } = raw;
        if !(1_200..=4_000_000).contains(&baud) {
            let help = "write the rate that the device is set to, e.g. baud = 115200";
            self.broken(&keys(&["turntable", "baud"]), format!("{baud} is no rate of a serial line"), help);
        }
        TurntableConfig { port, protocol, baud, counts_per_turn: Some(counts_per_turn).filter(|counts| *counts > 0) }
    }

    /// `Some(None)`: not set. `None`: set to a file that is no saved target, reported.
    fn saved(&mut self, text: &str) -> Option<Option<SavedFile>> {
        if text.is_empty() {
            return Some(None);
        }
        let path = keys(&["target", "saved"]);
        let found = self.file(&path, text);
        let file = self.needed(&path, found)?;
        match SavedTarget::read(&file.content) {
            Ok(target) => Some(Some(SavedFile { file, target })),
            Err(error) => {
                let help = "name a file that `tumbled target save` wrote, or leave `saved` out";
                self.broken(&path, format!("{} is no saved target: {error}", file.place), help);
                None
            }
        }
    }

    /// `Some(None)`: not set. `None`: set to something that is no address, reported.
    fn address(&mut self, path: &[Step], text: Option<&str>) -> Option<Option<IpAddr>> {
        let Some(text) = text.filter(|text| !text.is_empty()) else { return Some(None) };
        match text.parse() {
            Ok(address) => Some(Some(address)),
            Err(_) => {
                let message = format!("\"{text}\" is not an IP address");
                self.broken(path, message, "write the sensor's address, e.g. source = \"192.168.1.201\"");
                None
            }
        }
    }

    fn transform<F: Frame>(&mut self, path: &[Step], raw: &RawTransform) -> Option<Iso<Rig, F>> {
        match Iso::from_parts(raw.translation_m, raw.rotation_xyzw) {
            Ok(transform) => Some(transform),
            Err(error) => {
                let mut rotation = path.to_vec();
                rotation.push(Step::Key("rotation_xyzw".to_owned()));
                self.broken(&rotation, error.to_string(), unit_quaternion_help(raw.rotation_xyzw, error.norm));
                None
            }
        }
    }

    /// A file's path. A relative one starts at the file it was written in; on the command line, at the working
    /// directory, where the shell completes it. Empty: not set.
    pub(super) fn path(&self, path: &[Step], text: Option<&str>) -> Option<PathBuf> {
        let text = text.filter(|text| !text.is_empty())?;
        Some(self.tree.origin_at(path).directory().join(text))
    }

    /// The file that the key at a path names as `text`.
    fn file(&mut self, path: &[Step], text: &str) -> Result<RigFile, FileFault> {
        let origin = self.tree.origin_at(path);
        self.shelf.note(text, origin);
        self.shelf.take(&display_path(self.tree, path), text, origin)
    }

    /// A file without which the config cannot be used; `None`: it is not to be had, reported.
    fn needed(&mut self, path: &[Step], found: Result<RigFile, FileFault>) -> Option<RigFile> {
        let (FileFault::Absent(message) | FileFault::Unreadable(message)) = match found {
            Ok(file) => return Some(file),
            Err(fault) => fault,
        };
        let help = match self.tree.origin_at(path) {
            Origin::Text { source, .. } if source.layer == Layer::Recorded => {
                format!("name the file: --set {}=FILE", display_path(self.tree, path))
            }
            Origin::Text { source, .. } if !source.directory.as_os_str().is_empty() => {
                format!("correct the path: a relative one starts at {}", source.directory.display())
            }
            _ => "correct the path".to_owned(),
        };
        self.broken(path, message, help);
        None
    }
}

/// Whether `--set lidar.NAME` or `--set kinect.NAME` means a key.
fn is_sensor_key(name: &str) -> bool {
    use schemars::schema_for;
    let shapes = [super::shape::Shape::of(&schema_for!(RawLidar)), super::shape::Shape::of(&schema_for!(RawKinect))];
    shapes.iter().any(|shape| shape.key(name).is_some())
}

/// The remedy for a quaternion that is almost one: itself, normalised. For anything else: the form.
fn unit_quaternion_help(rotation_xyzw: [f64; 4], norm: f64) -> String {
    let nearly_unit = (0.5..=2.0).contains(&norm); // false for NaN
    if !nearly_unit {
        return "no rotation is rotation_xyzw = [0.0, 0.0, 0.0, 1.0]".to_owned();
    }
    let [x, y, z, w] = rotation_xyzw.map(|part| part / norm);
    format!("if the direction is right: rotation_xyzw = [{x:.9}, {y:.9}, {z:.9}, {w:.9}]")
}

/// Milliseconds of the config to a span; names and types have checked that they lie within an hour.
pub(super) fn span_of_ms(ms: f64) -> Span {
    Span((ms * 1e6).round() as i64)
}
