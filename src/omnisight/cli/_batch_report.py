"""Report of commands that process many images."""

from typing import TYPE_CHECKING

from omnisight.cli._output import write_json

if TYPE_CHECKING:
    from omnisight.pipeline.batch.batch import BatchResult

# Images without an output that are listed; all are in the records of the shards.
MAX_FAILED = 20


def print_batch(result: "BatchResult", output: str) -> None:
    """Print counts, speed, memory, and the images without an output with their reasons."""
    again = f", {result.resumed} of them by earlier runs" if result.resumed else ""
    print(f"images    {result.images}{again}; {result.written} written, {len(result.failed)} failed")
    for path, reason in result.failed[:MAX_FAILED]:
        print(f"          {path}: {reason}")
    if len(result.failed) > MAX_FAILED:
        print(f"          and {len(result.failed) - MAX_FAILED} more: see {output}/.omnisight/shards")
    if not result.workers:
        print(f"finished  by earlier runs: {output}")
        return
    speed = f"{result.images_per_second:.1f} images/s, {result.workers} workers"
    print(f"speed     {speed}; at most {result.peak_mb:.0f} MB a worker; {result.seconds:.1f} s")
    print(f"written   {output}")


def check_batch(result: "BatchResult") -> None:
    """Raise `ValueError` if images have no output, for the exit status."""
    if result.failed:
        raise ValueError(
            f"{len(result.failed)} of {result.images} images have no result; the others are finished:"
            " replace the listed files and run the same command again"
        )


def print_batch_json(result: "BatchResult", output: str) -> None:
    """Print the result as one JSON object."""
    values = {
        "images": result.images,
        "written": result.written,
        "failed": [{"image": path, "reason": reason} for path, reason in result.failed],
        "resumed": result.resumed,
        "workers": result.workers,
        "images_per_second": round(result.images_per_second, 3),
        "peak_mb": round(result.peak_mb, 1),
        "seconds": round(result.seconds, 3),
        "output": output,
    }
    write_json(values)
