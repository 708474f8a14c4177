//! What bounds refuse and how they say it; and the walk that every config's test takes.

use super::*;

/// Asserts that a config accepts itself, and that each of its numbers is refused by its key when it is absurd.
///
/// Left out: seeds, whose keys end in `seed`.
pub(crate) fn assert_every_number_is_checked<T>(config: &T)
where
    T: Check + serde::de::DeserializeOwned,
{
    fn numbers(value: &Value, path: &[String], found: &mut Vec<Vec<String>>) {
        match value {
            Value::Table(table) => {
                for (key, value) in table {
                    numbers(value, &[path, std::slice::from_ref(key)].concat(), found);
                }
            }
            Value::Array(values) if values.iter().any(Value::is_table) => {}
            other if holds_number(other) => found.push(path.to_vec()),
            _ => {}
        }
    }
    config.check().unwrap();
    let table = Value::try_from(config).unwrap();
    let mut keys = Vec::new();
    numbers(&table, &[], &mut keys);
    assert!(!keys.is_empty());
    for path in keys.iter().filter(|path| !path.last().unwrap().ends_with("seed")) {
        let key = path.join(".");
        let mut at = &table;
        path.iter().for_each(|part| at = &at[part.as_str()]);
        let mut absurd = vec![Value::Float(f64::NAN), Value::Float(-1e30)];
        // Infinity stands for all where it is valid.
        if key != "max_range_m" {
            absurd.extend([Value::Integer(i64::MAX), Value::Float(f64::INFINITY)]);
        }
        if let Some(values) = at.as_array() {
            absurd = absurd.into_iter().map(|value| Value::Array(vec![value; values.len()])).collect();
            absurd.push(Value::Array(vec![values[0].clone(); 100_000]));
        }
        for value in absurd {
            let mut changed = table.clone();
            let mut at = &mut changed;
            for part in path {
                at = &mut at[part.as_str()];
            }
            *at = value.clone();
            // A whole number takes no float, a fixed list no more entries, and a small one no huge number.
            let Ok(changed) = changed.try_into::<T>() else { continue };
            let told = changed.check().expect_err(&key);
            assert_eq!(told.key(), key, "{told}");
        }
    }
}

#[derive(Serialize)]
struct Example {
    share: f64,
    spacing_m: [f64; 2],
    edges: Vec<f64>,
    inner: Inner,
}

#[derive(Serialize)]
struct Inner {
    count: u32,
}

impl Bounds for Example {
    const BOUNDS: Keys = &[
        ("share", SHARE),
        ("spacing_m", from_to(1.0, 1000.0).pair()),
        ("edges", above(0.0, 9.0).rising(0, 3)),
        ("inner", Rule::Part(ConfigPart { keys: &[("count", from_to(1.0, 5.0))], docs: &[], about: &[] })),
    ];
}

impl Check for Example {}

fn told(change: fn(&mut Example)) -> String {
    let inner = Inner { count: 1 };
    let mut example = Example { share: 0.5, spacing_m: [2.0, 2.0], edges: vec![], inner };
    example.check().unwrap();
    change(&mut example);
    example.check().unwrap_err().to_string()
}

#[test]
fn a_message_says_key_value_and_what_is_valid() {
    assert_eq!(told(|e| e.share = f64::NAN), "share is nan; a number from 0 to 1 is needed");
    let spacing = "two numbers from 1 to 1000, ascending, are needed";
    assert_eq!(told(|e| e.spacing_m = [0.0, 0.0]), format!("spacing_m is [0.0, 0.0]; {spacing}"));
    assert_eq!(told(|e| e.spacing_m = [9.0, 2.0]), format!("spacing_m is [9.0, 2.0]; {spacing}"));
    assert_eq!(told(|e| e.inner.count = 6), "inner.count is 6; a number from 1 to 5 is needed");
    let edges = "0 to 3 numbers above 0 and at most 9, each above the one before, are needed";
    assert_eq!(told(|e| e.edges = vec![2.0, 2.0]), format!("edges is [2.0, 2.0]; {edges}"));
    assert!(told(|e| e.edges = vec![1.0; 50]).contains(".. (50 entries)]"));
}

#[test]
#[should_panic(expected = "`inner.new` has no bounds")]
fn a_number_without_bounds_is_found_on_any_config() {
    #[derive(Serialize)]
    struct Forgotten {
        inner: BTreeMap,
    }
    type BTreeMap = std::collections::BTreeMap<&'static str, u32>;
    impl Bounds for Forgotten {
        const BOUNDS: Keys = &[("inner", Rule::Part(ConfigPart { keys: &[], docs: &[], about: &[] }))];
    }
    impl Check for Forgotten {}
    let _ = Forgotten { inner: BTreeMap::from([("new", 1)]) }.check();
}
