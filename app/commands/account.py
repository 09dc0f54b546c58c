"""`pbpo account`: who may run studies."""

from __future__ import annotations

import typer

from app.services import accounts

from .asking import DataDir, out, studio_of

app = typer.Typer(no_args_is_help=True, help="Who may run studies.")


@app.command()
def create(email: str, data_dir: DataDir = None) -> None:
    """Make an account for an experimenter; asks for the password."""
    studio = studio_of(data_dir)
    password = typer.prompt("Password", hide_input=True, confirmation_prompt=True)
    accounts.create(studio, email, password)
    out.print(f"{email} can sign in at /sign-in.")


@app.command()
def token(email: str, label: str = "command line", data_dir: DataDir = None) -> None:
    """Make an API token for an experimenter, and show it this once."""
    studio = studio_of(data_dir)
    out.print(accounts.create_api_token(studio, accounts.find(studio, email), label))
