import json


def test_the_pipe_is_listed_and_a_camera_that_does_not_answer_is_a_row(run):
    assert "twin:pipe" in run("devices")[1]
    status, out, error = run("devices camera:ftp --json")
    (row,) = json.loads(out)["devices"]
    assert (status, error) == (1, "")
    assert (row["address"], row["what"], row["error"]) == ("camera:ftp", "camera", True)
