//! What people say of a run: its name, who runs it, a note.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The longest of its texts, bytes: as a marker's.
const MOST_BYTES: usize = 1_024;

/// What a run is called and what is to be remembered of it.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct RunInfo {
    /// Its name.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// A remark.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub note: Option<String>,
    /// Who runs it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub operator: Option<String>,
}

impl RunInfo {
    /// Its keys and texts, those that are there.
    fn texts(&self) -> impl Iterator<Item = (&'static str, &String)> {
        let texts = [("name", &self.name), ("note", &self.note), ("operator", &self.operator)];
        texts.into_iter().filter_map(|(key, text)| Some((key, text.as_ref()?)))
    }

    /// Whether nothing is said.
    pub fn is_empty(&self) -> bool {
        self.texts().next().is_none()
    }

    /// What is wrong with it.
    ///
    /// # Errors
    /// A text that is empty, long or of several lines, in words.
    pub fn check(&self) -> Result<(), String> {
        for (key, text) in self.texts() {
            let bytes = text.len();
            if bytes == 0 || bytes > MOST_BYTES || text.chars().any(char::is_control) {
                return Err(format!("the {key} has {bytes} bytes: it is one line of 1 to {MOST_BYTES} bytes"));
            }
        }
        Ok(())
    }

    /// As a recording keeps it.
    pub fn add_to(&self, notes: &mut BTreeMap<String, String>) {
        notes.extend(self.texts().map(|(key, text)| (key.to_owned(), text.clone())));
    }

    /// As a recording has kept it.
    pub fn of_notes(notes: &BTreeMap<String, String>) -> Self {
        let text = |key: &str| notes.get(key).cloned();
        Self { name: text("name"), note: text("note"), operator: text("operator") }
    }

    /// In one line, for the ledger.
    pub fn line(&self) -> String {
        let parts: Vec<String> = self.texts().map(|(key, text)| format!("{key}: {text}")).collect();
        parts.join("; ")
    }
}

/// What is said of the running session now. Clones share it.
#[derive(Clone, Debug, Default)]
pub struct SharedRunInfo(Arc<Mutex<RunInfo>>);

impl SharedRunInfo {
    /// Beginning with this.
    pub fn new(info: RunInfo) -> Self {
        Self(Arc::new(Mutex::new(info)))
    }

    /// As it is now.
    pub fn get(&self) -> RunInfo {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// What is given takes the place of what was said; the rest stays.
    pub fn change(&self, new: RunInfo) {
        let mut info = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let RunInfo { name, note, operator } = std::mem::take(&mut *info);
        *info = RunInfo { name: new.name.or(name), note: new.note.or(note), operator: new.operator.or(operator) };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_change_leaves_what_it_does_not_name_and_texts_are_one_line() {
        let text = |text: &str| Some(text.to_owned());
        let info = SharedRunInfo::new(RunInfo { name: text("spin 7"), ..RunInfo::default() });
        info.change(RunInfo { note: text("lamp off"), ..RunInfo::default() });
        assert_eq!(info.get().line(), "name: spin 7; note: lamp off");
        let mut notes = BTreeMap::new();
        info.get().add_to(&mut notes);
        assert_eq!(
            notes.into_iter().collect::<Vec<_>>(),
            [("name".to_owned(), "spin 7".to_owned()), ("note".to_owned(), "lamp off".to_owned())]
        );
        assert_eq!(info.get().check(), Ok(()));
        for wrong in ["", "two\nlines", &"x".repeat(1_025)] {
            let info = RunInfo { operator: text(wrong), ..RunInfo::default() };
            assert!(info.check().is_err_and(|error| error.contains("operator")), "{wrong:?}");
        }
    }
}
