"""Commands of the program, run in the tests' own process."""

from typer.testing import CliRunner, Result

from fapengine.cli.main import app


def ran(*words: object, code: int = 0) -> Result:
    """Run a command that ends with a code; its errors are raised."""
    result = CliRunner().invoke(app, [str(word) for word in words], env={"COLUMNS": "200"}, catch_exceptions=False)
    assert result.exit_code == code, result.output
    return result


def run(*words: object, code: int = 0) -> str:
    """Run a command, and return all that it prints."""
    return ran(*words, code=code).output
