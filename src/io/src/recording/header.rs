//! What a recording says of itself at its start.

use core::fmt;
use std::collections::BTreeMap;
use tumbled_model::UnixNs;

/// Version of the format of [`super::layout`] and of the metadata records.
pub const FORMAT_VERSION: u32 = 1;

/// The MCAP profile that marks a file as one of these recordings.
pub const PROFILE: &str = "tumbled";

/// Name of the metadata record at a part's start.
pub(crate) const START_RECORD: &str = "tumbled";
/// Name of the metadata record at a part's end.
pub(crate) const END_RECORD: &str = "tumbled.end";
/// Name of the attachment with the effective config, TOML.
pub(crate) const CONFIG_ATTACHMENT: &str = "config.toml";
/// Name of the attachment with the calibration, TOML.
pub(crate) const CALIBRATION_ATTACHMENT: &str = "calibration.toml";

/// Where the events of a recording come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Origin {
    /// Sensors, as it happened.
    #[default]
    Live,
    /// Captures of other programs.
    Import,
    /// Simulated sensors: never to be taken for a measurement.
    Simulated,
}

impl Origin {
    /// The word in the file.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Live => "live",
            Self::Import => "import",
            Self::Simulated => "simulated",
        }
    }

    fn from_name(name: &str) -> Option<Self> {
        [Self::Live, Self::Import, Self::Simulated].into_iter().find(|origin| origin.name() == name)
    }
}

impl fmt::Display for Origin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// A file that a recording was made from.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct InputFile {
    /// Its name without folders: the folder is the machine's and not the data's.
    pub name: String,
    /// Its size.
    pub bytes: u64,
    /// BLAKE3 of its content, 64 hex digits.
    pub blake3: String,
}

/// What a recording says of itself at the start of every part.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RecordingHeader {
    /// The session: parts of one recording have the same. Not empty.
    pub session: String,
    /// Where the events come from.
    pub origin: Origin,
    /// Program and commit that recorded, e.g. `0.1.0 (122e041f3c5d)`.
    pub program: String,
    /// Wall time at `t_ns` 0.
    pub unix_at_zero: UnixNs,
    /// The times are made up (frames numbered at 30 Hz): they have no relation to any clock.
    pub synthetic_times: bool,
    /// The effective config, TOML; empty: none attached.
    pub config: String,
    /// The calibration, TOML; empty: none attached.
    pub calibration: String,
    /// Files it was imported from.
    pub inputs: Vec<InputFile>,
    /// Anything else worth knowing later: operator, sensor serial numbers, a note.
    pub notes: BTreeMap<String, String>,
}

impl RecordingHeader {
    /// The start record of part `part`, counted from 0.
    pub(crate) fn to_metadata(&self, part: u32) -> BTreeMap<String, String> {
        let mut map = BTreeMap::new();
        let mut put = |key: &str, value: String| map.insert(key.to_owned(), value);
        put("format", FORMAT_VERSION.to_string());
        put("session", self.session.clone());
        put("origin", self.origin.to_string());
        put("program", self.program.clone());
        put("unix_ns_at_zero", self.unix_at_zero.0.to_string());
        put("times", if self.synthetic_times { "synthetic" } else { "host" }.to_owned());
        put("part", part.to_string());
        for (n, input) in self.inputs.iter().enumerate() {
            // Six digits, so that the map's order is the inputs'.
            put(&format!("input.{n:06}.name"), input.name.clone());
            put(&format!("input.{n:06}.bytes"), input.bytes.to_string());
            put(&format!("input.{n:06}.blake3"), input.blake3.clone());
        }
        for (key, value) in &self.notes {
            put(&format!("note.{key}"), value.clone());
        }
        map
    }

    /// The header and the number of the part; the texts come from the attachments.
    pub(crate) fn from_metadata(map: &BTreeMap<String, String>) -> Result<(Self, u32), HeaderFault> {
        let text = |key: &'static str| map.get(key).ok_or(HeaderFault::Missing { key });
        let number = |key: &'static str| {
            let found = text(key)?;
            found.parse::<i64>().ok().ok_or_else(|| HeaderFault::Field { key, found: found.clone() })
        };
        let format = number("format")?;
        if format != i64::from(FORMAT_VERSION) {
            return Err(HeaderFault::Version { found: format });
        }
        let origin_name = text("origin")?;
        let origin = Origin::from_name(origin_name)
            .ok_or_else(|| HeaderFault::Field { key: "origin", found: origin_name.clone() })?;
        let part = number("part")?;
        let part =
            u32::try_from(part).ok().ok_or_else(|| HeaderFault::Field { key: "part", found: part.to_string() })?;
        let notes = map.iter().filter_map(|(key, value)| Some((key.strip_prefix("note.")?.to_owned(), value.clone())));
        let header = Self {
            session: text("session")?.clone(),
            origin,
            program: map.get("program").cloned().unwrap_or_default(),
            unix_at_zero: UnixNs(number("unix_ns_at_zero")?),
            synthetic_times: map.get("times").is_some_and(|times| times == "synthetic"),
            config: String::new(),
            calibration: String::new(),
            inputs: inputs(map),
            notes: notes.collect(),
        };
        Ok((header, part))
    }
}

fn inputs(map: &BTreeMap<String, String>) -> Vec<InputFile> {
    let mut inputs: BTreeMap<&str, InputFile> = BTreeMap::new();
    for (key, value) in map {
        let Some((n, field)) = key.strip_prefix("input.").and_then(|rest| rest.split_once('.')) else { continue };
        let input = inputs.entry(n).or_default();
        match field {
            "name" => input.name = value.clone(),
            "bytes" => input.bytes = value.parse().unwrap_or_default(),
            "blake3" => input.blake3 = value.clone(),
            _ => {}
        }
    }
    inputs.into_values().collect()
}

/// Why a start record cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum HeaderFault {
    /// A key is not there.
    #[error("its start record has no `{key}`")]
    Missing {
        /// The key.
        key: &'static str,
    },
    /// A key's value is not what it should be.
    #[error("its start record says {key} = {found:?}")]
    Field {
        /// The key.
        key: &'static str,
        /// Its value.
        found: String,
    },
    /// Another version of the format.
    #[error(
        "it has format version {found}, this program reads version {FORMAT_VERSION}: use the program that wrote it or a newer one"
    )]
    Version {
        /// The version.
        found: i64,
    },
}
