//! "Did you mean": the known name that is nearest to one that is not known.

/// Names less alike than this (Jaro-Winkler, 0 to 1) are no suggestion; clap asks for as much.
const LEAST_ALIKE: f64 = 0.7;

/// The known name most like `name`, if one is alike.
pub fn nearest<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let alike = |known: &'a str| (strsim::jaro_winkler(name, known), known);
    let found = known.into_iter().map(alike).filter(|(alike, _)| *alike > LEAST_ALIKE);
    found.max_by(|(a, _), (b, _)| a.total_cmp(b)).map(|(_, known)| known)
}

/// An error of serde's with the nearest of the names that it expected, if one is alike.
#[must_use]
pub fn with_suggestion(message: String) -> String {
    let is_unknown = ["unknown field", "unknown variant"].iter().any(|what| message.contains(what));
    // Of a message with the lines of a file, the last one alone.
    let line = message.trim_end().lines().last().unwrap_or_default();
    let mut names = line.split('`').skip(1).step_by(2);
    let Some(found) = names.next().filter(|_| is_unknown) else { return message };
    match nearest(found, names) {
        Some(name) => format!("{}; did you mean `{name}`?", message.trim_end()),
        None => message,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_of_the_expected_names_is_suggested() {
        let told = with_suggestion("unknown field `sped`, expected one of `speed`, `town`".into());
        assert!(told.ends_with("did you mean `speed`?"), "{told}");
        for message in ["unknown field `xyz`, expected one of `speed`, `town`", "invalid type: `sped`"] {
            assert_eq!(with_suggestion(message.into()), message);
        }
    }
}
