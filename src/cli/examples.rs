//! Examples of every command, at the end of its help.

use std::fmt::Write as _;

use clap::builder::StyledStr;
use clap::builder::styling::Style;

/// A command's words, and its examples: what they do, and the line.
type Examples = (&'static str, &'static [(&'static str, &'static str)]);

const EXAMPLES: &[Examples] = &[
    (
        "gen",
        &[
            ("A small data set to train on", "harmzone gen --out data/id --preset demo"),
            (
                "Unfamiliar objects in every town and weather, 20 episodes of one seed",
                "harmzone gen --out data/ood --ood --town all --weather all --episodes 20 --seed 7",
            ),
            (
                "A town of your own, six cameras, heavy rain",
                "harmzone gen --out data/mine --town maps/mine.xodr --rig surround --weather HardRainNoon",
            ),
        ],
    ),
    (
        "merge",
        &[("Join what `gen --shard 0/2` and `--shard 1/2` made", "harmzone merge part0 part1 --out data/id")],
    ),
    ("migrate", &[("What an older data set would become", "harmzone migrate data/id --dry-run")]),
    ("import", &[("A drive of KITTI, and what it holds", "harmzone import kitti KITTI --out data/kitti")]),
    (
        "import nuscenes",
        &[(
            "Two scenes of the mini set",
            "harmzone import nuscenes nuscenes/v1.0-mini --scenes scene-0061,scene-0103 --out data/nuscenes",
        )],
    ),
    ("import kitti", &[("Every tenth frame", "harmzone import kitti KITTI --every 10 --out data/kitti")]),
    ("import av2", &[("A folder of logs", "harmzone import av2 av2/sensor/val --out data/av2")]),
    (
        "import ros2",
        &[
            (
                "What the bag has, and the mapping that it is read by",
                "harmzone import ros2 drive.mcap --list > mapping.toml",
            ),
            (
                "With the mapping, mended by hand",
                "harmzone import ros2 drive.mcap --mapping mapping.toml --out data/drive",
            ),
        ],
    ),
    (
        "import predictions",
        &[(
            "Boxes of another detector, to be viewed beside the truth",
            "harmzone import predictions boxes.json --format nuscenes --data data/id --out boxes",
        )],
    ),
    (
        "label",
        &[
            ("By the paper's rectangle", "harmzone label data/id"),
            (
                "By time to collision, as a second set of labels",
                "harmzone label data/id --set kind=ttc --labels ttc",
            ),
        ],
    ),
    ("zones", &[("How much the zones differ", "harmzone zones data/id")]),
    (
        "info",
        &[("Counts and shares, with a picture of the histograms", "harmzone info data/id --plot counts.png")],
    ),
    ("compare", &[("How far simulation is from a real log", "harmzone compare data/kitti data/sim")]),
    (
        "train",
        &[
            (
                "The shipped recipe; the same command again resumes it",
                "harmzone train data/id --out runs/first",
            ),
            ("What it would take: parameters, memory, steps", "harmzone train data/id --dry-run"),
            (
                "Two epochs, another seed",
                "harmzone train data/id --out runs/short --set fused_stage.epochs=2 --set seed=1",
            ),
        ],
    ),
    ("curves", &[("Of a training under way, too", "harmzone curves runs/first")]),
    (
        "predict",
        &[("Boxes of the network inside the program", "harmzone predict small --data data/ood --out boxes")],
    ),
    (
        "eval",
        &[
            (
                "A run, out of distribution, with figures by kind and range",
                "harmzone eval runs/first --data data/ood --ood --breakdown",
            ),
            (
                "Any detector's boxes",
                "harmzone eval --predictions boxes.json --data data/ood --ood --out scores",
            ),
        ],
    ),
    (
        "calibrate",
        &[(
            "Warn from the score that costs 10 false alarms a kilometre",
            "harmzone calibrate runs/first --data data/id",
        )],
    ),
    (
        "baseline",
        &[(
            "The zone's rule over a network's boxes, as a rival",
            "harmzone baseline zone runs/first --data data/ood",
        )],
    ),
    (
        "versus",
        &[
            (
                "What the camera brings to a network: with its pictures, against black ones",
                "harmzone versus camera-blind:runs/first runs/first --data data/ood --ood",
            ),
            (
                "Two trainings, the zone's rule over the first one's boxes, and true boxes",
                "harmzone versus a=runs/a b=runs/b rule=zone:runs/a truth --data data/ood --ood --out versus",
            ),
        ],
    ),
    (
        "drive",
        &[
            (
                "The shipped network against who sees nothing and who sees all",
                "harmzone drive blind truth small --ood --episodes 12 --out drives",
            ),
            (
                "A detector of your own on the suite",
                "harmzone drive 'mine=exec:python detector.py' --scenarios suite --out drives",
            ),
        ],
    ),
    (
        "sweep",
        &[(
            "What the network makes of other speeds and steering angles",
            "harmzone sweep runs/first --data data/id --out sweep",
        )],
    ),
    ("report", &[("One page of both scores", "harmzone report report.html --id scores/id --ood scores/ood")]),
    (
        "view",
        &[
            ("One sample", "harmzone view data/ood --sample 12 --out sample.png"),
            (
                "A clip with the network's boxes",
                "harmzone view data/ood --video clip.mp4 --predictions small",
            ),
            ("For Foxglove", "harmzone view data/ood --mcap look.mcap"),
        ],
    ),
    ("serve", &[("Browse a folder", "harmzone serve data")]),
    ("foxglove-layout", &[("Write the layout", "harmzone foxglove-layout --out layout.json")]),
    ("export", &[("For mmdetection3d", "harmzone export kitti data/id kitti")]),
    ("export nuscenes", &[("For nuscenes-devkit", "harmzone export nuscenes data/id nuscenes")]),
    ("export kitti", &[("For OpenPCDet", "harmzone export kitti data/id kitti --categories kinds")]),
    (
        "export predictions",
        &[(
            "For nuscenes-devkit's evaluation",
            "harmzone export predictions boxes results.json --data data/id --format nuscenes",
        )],
    ),
    (
        "doctor",
        &[
            ("This machine", "harmzone doctor"),
            ("A data set", "harmzone doctor data/id"),
            ("Mend what can be mended", "harmzone doctor data/id --fix"),
        ],
    ),
    ("init", &[("A folder to work in", "harmzone init my-project")]),
    ("config", &[("What a key is", "harmzone config explain ood_spacing_m")]),
    (
        "config show",
        &[
            ("All settings of gen, as a file to change", "harmzone config show gen > gen.toml"),
            ("What a file changes", "harmzone config show train --config train.toml --changed"),
        ],
    ),
    ("config explain", &[("A table with all its keys", "harmzone config explain scene.people")]),
    ("config reference", &[("The page of the docs", "harmzone config reference > config.md")]),
    (
        "completions",
        &[
            (
                "For bash, of this user",
                "harmzone completions bash > ~/.local/share/bash-completion/completions/harmzone",
            ),
            ("For zsh", "harmzone completions zsh > ~/.zfunc/_harmzone"),
        ],
    ),
    (
        "man",
        &[
            ("Read a page", "harmzone man gen | man -l -"),
            ("Install all", "harmzone man --out ~/.local/share/man/man1"),
        ],
    ),
];

/// The command with the examples of all that is in it.
pub fn with_examples(command: clap::Command) -> clap::Command {
    fn add(command: clap::Command, words: &str) -> clap::Command {
        let command = command.mut_subcommands(|inner| {
            let words = format!("{words} {}", inner.get_name());
            add(inner, words.trim())
        });
        match EXAMPLES.iter().find(|(of, _)| *of == words) {
            Some((_, examples)) => command.after_help(text(examples)),
            None => command,
        }
    }
    add(command, "")
}

fn text(examples: &[(&str, &str)]) -> StyledStr {
    let heading = Style::new().bold().underline();
    let mut out = StyledStr::new();
    let _ = write!(out, "{heading}Examples:{heading:#}");
    for (what, line) in examples {
        let _ = write!(out, "\n  {what}:\n    {line}");
    }
    let _ = writeln!(out);
    out
}

#[cfg(test)]
mod tests {
    use super::super::tests::answer;
    use super::*;

    #[test]
    fn every_command_has_examples_and_they_are_valid() {
        fn check(command: &clap::Command, words: &str, seen: &mut Vec<String>) {
            for inner in command.get_subcommands().filter(|inner| inner.get_name() != "help") {
                let words = format!("{words} {}", inner.get_name()).trim().to_owned();
                assert!(EXAMPLES.iter().any(|(of, _)| *of == words), "no example of {words}");
                check(inner, &words, seen);
                seen.push(words);
            }
        }
        let mut seen = Vec::new();
        check(&super::super::visible(), "", &mut seen);
        for (words, examples) in EXAMPLES {
            assert!(seen.iter().any(|known| known == words), "no command `{words}`");
            for (_, line) in *examples {
                let line = line.split(['>', '|']).next().unwrap();
                let args = shlex::split(line).unwrap();
                assert!(line.starts_with("harmzone "), "{line}");
                let told = answer(&args[1..].iter().map(String::as_str).collect::<Vec<_>>());
                assert!(told.is_empty(), "{line}: {told}");
            }
        }
    }
}
