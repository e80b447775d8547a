//! What a recording says of itself at its start.

use core::fmt;
use std::collections::BTreeMap;
use tumbled_model::UnixNs;

use super::attached::{AttachedFile, MAX_FILES};
use super::layout::MAX_CONFIG_BYTES;

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

/// The start record's key for the config's digest.
const CONFIG_DIGEST: &str = "config.blake3";
/// In place of the digest: the config was damaged already when this copy was made.
const DAMAGED: &str = "damaged";

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
    /// The effective config, TOML, calibration applied; empty: none attached.
    pub config: String,
    /// A config was attached and this copy of it is damaged; `config` is empty then.
    pub config_damaged: bool,
    /// The files the config names, as they were.
    pub files: Vec<AttachedFile>,
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
        if self.config_damaged {
            put(CONFIG_DIGEST, DAMAGED.to_owned());
        } else if !self.config.is_empty() {
            put(CONFIG_DIGEST, blake3::hash(self.config.as_bytes()).to_hex().to_string());
        }
        for (n, input) in self.inputs.iter().enumerate() {
            // Six digits, so that the map's order is the inputs'.
            put_file(&mut put, &format!("input.{n:06}"), input);
        }
        for (n, attached) in self.files.iter().enumerate() {
            put(&format!("file.{n:06}.key"), attached.key.clone());
            put_file(&mut put, &format!("file.{n:06}"), &attached.file);
        }
        for (key, value) in &self.notes {
            put(&format!("note.{key}"), value.clone());
        }
        map
    }

    /// The header and the number of the part; the config's text and the files come from the attachments.
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
            // Until its attachment is found: [`RecordingHeader::take_config`].
            config_damaged: map.contains_key(CONFIG_DIGEST),
            files: files(map),
            inputs: numbered(map, "input.").into_values().map(|(input, _)| input).collect(),
            notes: notes.collect(),
        };
        Ok((header, part))
    }

    /// Takes the config's attachment, provided it is what the start record, `map`, was written for.
    pub(crate) fn take_config(&mut self, map: &BTreeMap<String, String>, data: &[u8]) {
        let digest = map.get(CONFIG_DIGEST);
        let same = digest.is_none_or(|digest| blake3::hash(data).to_hex().as_str() == digest);
        let text = std::str::from_utf8(data).ok().filter(|text| same && text.len() <= MAX_CONFIG_BYTES);
        self.config_damaged = text.is_none();
        self.config = text.unwrap_or_default().to_owned();
    }
}

/// Name, size and digest of a file, under a prefix of its own.
fn put_file(put: &mut impl FnMut(&str, String) -> Option<String>, prefix: &str, file: &InputFile) {
    put(&format!("{prefix}.name"), file.name.clone());
    put(&format!("{prefix}.bytes"), file.bytes.to_string());
    put(&format!("{prefix}.blake3"), file.blake3.clone());
}

/// The files whose keys begin with a prefix and a number, in the order of the numbers, each with its `key`.
fn numbered<'a>(map: &'a BTreeMap<String, String>, prefix: &str) -> BTreeMap<&'a str, (InputFile, String)> {
    let mut found: BTreeMap<&str, (InputFile, String)> = BTreeMap::new();
    for (key, value) in map {
        let Some((n, field)) = key.strip_prefix(prefix).and_then(|rest| rest.split_once('.')) else { continue };
        let (file, config_key) = found.entry(n).or_default();
        match field {
            "name" => file.name = value.clone(),
            "bytes" => file.bytes = value.parse().unwrap_or_default(),
            "blake3" => file.blake3 = value.clone(),
            "key" => *config_key = value.clone(),
            _ => {}
        }
    }
    found
}

/// The attached files as the start record lists them; their contents come from the attachments.
fn files(map: &BTreeMap<String, String>) -> Vec<AttachedFile> {
    let listed = numbered(map, "file.").into_values().take(MAX_FILES);
    listed.map(|(file, key)| AttachedFile { key, file, content: None }).collect()
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
