//! The one error type of the library. Every message says what is wrong, where,
//! and what to do about it.

use std::path::PathBuf;

/// Result of a library call.
pub type Result<T> = std::result::Result<T, Error>;

/// What can go wrong, each with the place and the remedy.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A file or folder could not be read or written.
    #[error("{}: cannot {action}: {source}", path.display())]
    Io {
        /// File or folder concerned.
        path: PathBuf,
        /// `read`, `write`, ... as it reads after "cannot".
        action: &'static str,
        /// What the operating system says.
        source: std::io::Error,
    },
    /// A volume file is damaged, or of a kind that is not read.
    #[error("{}: {what}", path.display())]
    Volume {
        /// The file.
        path: PathBuf,
        /// What is wrong with it and what to do.
        what: String,
    },
    /// A scene says something impossible or unknown.
    #[error("{}{}: {what}", path.display(), line.map(|l| format!(":{l}")).unwrap_or_default())]
    Scene {
        /// The scene file.
        path: PathBuf,
        /// Line in the file, counted from 1, where it is known.
        line: Option<usize>,
        /// What is wrong and what would be right.
        what: String,
    },
    /// An image file cannot be read or written as asked.
    #[error("{}: {what}", path.display())]
    Image {
        /// The file.
        path: PathBuf,
        /// What is wrong and what to do.
        what: String,
    },
    /// A value given to the library, or on the command line, cannot be.
    #[error("{what}")]
    Setting {
        /// Which value, why not, and what would do.
        what: String,
    },
    /// No graphics adapter fits.
    #[error("{what}")]
    Adapter {
        /// What was looked for, what was found, and what to install or name.
        what: String,
    },
    /// A stage failed on the device: a validation error, a lost device, a refused allocation.
    #[error("stage `{stage}`: {what}")]
    Device {
        /// The dispatch or allocation that failed.
        stage: String,
        /// What the device says.
        what: String,
    },
    /// A fixed capacity would overflow, or memory would not suffice.
    #[error("stage `{stage}`: {what}")]
    Capacity {
        /// The stage whose buffer or counter it is.
        stage: String,
        /// Needed, available, and the setting to change.
        what: String,
    },
}

impl Error {
    /// A refused setting.
    pub fn setting(what: impl Into<String>) -> Self {
        Self::Setting { what: what.into() }
    }

    /// A damaged or unsupported volume.
    pub fn volume(path: impl Into<PathBuf>, what: impl Into<String>) -> Self {
        Self::Volume { path: path.into(), what: what.into() }
    }

    /// A failure of the named stage on the device.
    pub fn device(stage: impl Into<String>, what: impl Into<String>) -> Self {
        Self::Device { stage: stage.into(), what: what.into() }
    }

    /// A capacity that does not suffice.
    pub fn capacity(stage: impl Into<String>, what: impl Into<String>) -> Self {
        Self::Capacity { stage: stage.into(), what: what.into() }
    }
}
