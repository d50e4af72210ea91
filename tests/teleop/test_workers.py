import asyncio

from minorloop.teleop import workers


def told(task, *, longest=60.0, times=1, **options):
    """What tasks tell, one after the other, on one worker."""

    async def ask():
        pool = workers.Workers(1, longest=longest)
        await pool.start()
        try:
            return [[each async for each in pool.run(task, **options)] for _ in range(times)]
        finally:
            await pool.stop()

    return asyncio.run(ask())


def test_refusals_are_sentences_and_the_worker_goes_on(tmp_path):
    for (answer,) in told("move", times=2, folder=str(tmp_path), memory=None, u=0.5):
        assert "no model yet" in answer["error"]


def test_a_file_that_is_not_there_is_a_refusal(tmp_path):
    ((answer,),) = told("look", folder=str(tmp_path), name="none.csv")
    assert "none.csv" in answer["error"]


def test_what_a_process_takes_to_begin_is_not_what_a_task_takes(tmp_path):
    ((answer,),) = told("look", longest=0.5, folder=str(tmp_path), name="none.csv")
    assert "none.csv" in answer["error"]


def test_what_takes_too_long_is_ended_and_the_next_is_served(tmp_path):
    first, second = told("move", times=2, longest=1e-6, folder=str(tmp_path), memory=None, u=0.5)
    assert "took over" in first[-1]["error"]
    assert "took over" in second[-1]["error"]


def test_a_worker_that_dies_is_replaced(tmp_path):
    async def ask():
        pool = workers.Workers(1)
        await pool.start()
        try:
            for worker in pool._all:
                worker._process.kill()
                worker._process.join()
            first = await pool.ask("move", folder=str(tmp_path), memory=None, u=0.5)
            second = await pool.ask("move", folder=str(tmp_path), memory=None, u=0.5)
            return first, second
        finally:
            await pool.stop()

    first, second = asyncio.run(ask())
    assert "ended unexpectedly" in first["error"]
    assert "no model yet" in second["error"]
