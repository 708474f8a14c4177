//! JSON with some of its values replaced: fuzzers seldom hit a key, or a number's place, of a long text.

use serde_json::Value;

/// What a number becomes: the ends of the ranges of numbers.
const NUMBERS: [&str; 18] = [
    "0",
    "1",
    "-1",
    "0.5",
    "2",
    "100",
    "65536",
    "4294967295",
    "4294967296",
    "9223372036854775807",
    "9223372036854775808",
    "18446744073709551615",
    "1e16",
    "1e300",
    "-1e300",
    "5e-324",
    "1e-13",
    "-0.0",
];
const WORDS: [&str; 6] = ["\"\"", "\"x\"", "\"../x\"", "\"1e999\"", "\"\\u0000\"", "\"truth\""];
const OTHERS: [&str; 6] = ["null", "true", "false", "[]", "[0, 0]", "{}"];

/// Bytes that are read of an input: three say what one value becomes.
const MOST_EDITS: usize = 40;

/// The JSON after some edits: each takes two bytes for the place, counted through the whole, and one for the new value, which
/// mostly is one of the same kind; from 224 on an array or object loses its last member instead, or has it twice.
pub fn patched(json: &str, edits: &[u8]) -> String {
    let mut value: Value = serde_json::from_str(json).expect("it was made by a writer");
    for edit in edits.as_chunks::<3>().0.iter().take(MOST_EDITS) {
        let [low, high, new] = *edit;
        let mut n_places = 0;
        walk(&mut value, &mut |_| {
            n_places += 1;
            true
        });
        let mut left = usize::from(u16::from_le_bytes([low, high])) % n_places;
        walk(&mut value, &mut |at| {
            if left == 0 {
                change(at, new);
                return false;
            }
            left -= 1;
            true
        });
    }
    serde_json::to_string_pretty(&value).expect("it is JSON")
}

fn change(at: &mut Value, new: u8) {
    match (at, new) {
        (Value::Array(items), 224..=239) => _ = items.pop(),
        (Value::Array(items), 240..) => items.extend(items.last().cloned()),
        (Value::Object(members), 224..) => {
            let last = members.keys().next_back().cloned();
            last.map(|key| members.remove(&key));
        }
        (at, new) => {
            let values: &[&str] = match at {
                _ if new >= 192 => &OTHERS,
                Value::String(_) => &WORDS,
                Value::Bool(_) | Value::Array(_) | Value::Object(_) => &OTHERS,
                Value::Number(_) | Value::Null => &NUMBERS,
            };
            *at = serde_json::from_str(values[usize::from(new) % values.len()]).expect("each is JSON");
        }
    }
}

/// Goes through a value and all within it until `see` says no; returns whether it never did.
fn walk(value: &mut Value, see: &mut dyn FnMut(&mut Value) -> bool) -> bool {
    if !see(value) {
        return false;
    }
    match value {
        Value::Array(items) => items.iter_mut().all(|item| walk(item, see)),
        Value::Object(members) => members.values_mut().all(|member| walk(member, see)),
        _ => true,
    }
}

/// Edits to begin with: one at each of some places, of each kind of value.
pub fn seeds() -> Vec<Vec<u8>> {
    let mut seeds = vec![Vec::new()];
    seeds.extend((0..48_u16).map(|i| [(i * 3).to_le_bytes().as_slice(), &[(i % 18) as u8]].concat()));
    seeds.push(
        [0_u16, 7, 30, 61].iter().flat_map(|at| [at.to_le_bytes().as_slice(), &[13]].concat()).collect(),
    );
    seeds
}
