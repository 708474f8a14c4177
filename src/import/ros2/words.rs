//! Words in the names of topics and frames: `/gnss/fix_velocity` holds `gnss`, `fix` and `velocity`.

/// Whether a name holds one of these lower-case words as a whole: between slashes, underscores, digits and the like.
#[must_use]
pub fn has_word(name: &str, words: &[&str]) -> bool {
    let name = name.to_lowercase();
    name.split(|c: char| !c.is_ascii_alphabetic()).any(|part| words.contains(&part))
}

/// Whether a name holds one of these lower-case texts anywhere, also within a word.
#[must_use]
pub fn holds(name: &str, texts: &[&str]) -> bool {
    let name = name.to_lowercase();
    texts.iter().any(|text| name.contains(text))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_word_is_not_a_part_of_another() {
        assert!(has_word("/camera/image_rect_color", &["rect"]) && has_word("/GNSS0/fix", &["gnss"]));
        assert!(!has_word("/camera/image_unrect", &["rect"]) && !has_word("/direct/image", &["rect"]));
        assert!(holds("/cloud_undistorted", &["undistort"]));
    }
}
