//! The list of zones: a new one is a file with its rule and a line here.

use serde::{Deserialize, Serialize};

/// Hands every zone to a macro: kind, name in files, rule.
macro_rules! for_each_zone {
    ($then:ident) => {
        $then! {
            /// The paper's rectangle, turned by the steering angle.
            #[default]
            Rect = ("rect", rect::Rect),
            /// A lane-wide corridor as deep as the rectangle, along the arc that the ego drives.
            Arc = ("arc", arc::Arc),
            /// Contact with the ego's body within a time, if both keep their motion.
            Ttc = ("ttc", ttc::Ttc),
            /// Nearer than the longitudinal and the lateral safe distance of RSS.
            Rss = ("rss", rss::Rss),
        }
    };
}
pub(super) use for_each_zone;

macro_rules! define_kinds {
    ($($(#[$attribute:meta])* $Kind:ident = ($name:literal, $Rule:path),)*) => {
        /// The shape of the zone.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
        pub enum ZoneKind { $($(#[$attribute])* #[serde(rename = $name)] $Kind,)* }

        impl ZoneKind {
            /// All of them; the paper's first.
            pub const ALL: [Self; [$($name),*].len()] = [$(Self::$Kind),*];
            const NAMES: [&'static str; Self::ALL.len()] = [$($name),*];
        }
    };
}
for_each_zone!(define_kinds);

impl ZoneKind {
    /// The name in files.
    #[must_use]
    pub fn name(self) -> &'static str {
        Self::NAMES[self as usize]
    }
}
