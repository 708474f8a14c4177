//! The day of a time, as logs write it.

/// The day of a time, `2026-11-22` (Hinnant's days to civil).
pub(super) fn date(time_us: u64) -> String {
    let days = time_us / 86_400_000_000 + 719_468;
    let (era, day) = (days / 146_097, days % 146_097);
    let year = (day - day / 1460 + day / 36_524 - day / 146_096) / 365;
    let day = day - (365 * year + year / 4 - year / 100);
    let month = (5 * day + 2) / 153;
    let (day, month) = (day - (153 * month + 2) / 5 + 1, if month < 10 { month + 3 } else { month - 9 });
    format!("{:04}-{month:02}-{day:02}", year + era * 400 + u64::from(month <= 2))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn days_are_those_of_the_calendar() {
        assert_eq!(date(0), "1970-01-01");
        assert_eq!(date(1_533_151_603_547_590), "2018-08-01");
        assert_eq!(date(1_709_164_800_000_000), "2024-02-29");
    }
}
