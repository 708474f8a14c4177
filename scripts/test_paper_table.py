"""The tables of `make paper-run`, from a made-up run."""

import json

import paper_table


def test_times_of_all_calls_add_up_and_give_the_cost_of_a_step(tmp_path, monkeypatch, capsys):
    ap = {"harmful": 0.5, "harmless": None, "mean": 0.25}
    for folder in ("eval-id", "eval-ood"):
        (tmp_path / folder).mkdir()
        columns = dict.fromkeys(["total", "id_matched", "ood_all", "ood_matched"], ap)
        (tmp_path / folder / "metrics.json").write_text(json.dumps(columns))
    (tmp_path / "run").mkdir()
    (tmp_path / "run/log.csv").write_text("n_done,stage\n1,lidar\n2,lidar\n3,lidar\n4,fused\n")
    (tmp_path / "run/time.json").write_text('{"wall_s": 7200.0, "cpu_s": 1.0, "n_calls": 2}')
    (tmp_path / "times.tsv").write_text("time\ttrain\t3600\ntime\ttrain\t5400\ndone\ttrain\n")
    (tmp_path / "profile.txt").write_text("step  12 ms\n")
    monkeypatch.setenv("PAPER_PRICE", "4")
    monkeypatch.setattr("sys.argv", ["paper_table.py", str(tmp_path)])
    paper_table.main()
    told = capsys.readouterr().out
    assert "| ID: mAP | 0.500 | unknown | 0.250 |" in told
    assert "| train | 2.50 | 10 |" in told and "| all | 2.50 | 10 |" in told
    assert "4 steps (3 lidar, 1 fused), 1800.000 s each" in told and "2 a step; 2 calls" in told
    assert "step  12 ms" in told
