"""`pbpo machine ...`: the machines that record videos of a study, and their emergency stop."""

from __future__ import annotations

from typing import Annotated

import typer
from rich.table import Table

from app.services.rollouts import machines
from app.services.studies import repository

from .options import Address, DataDir, Slug, address_of, app_context_of, out

commands = typer.Typer(no_args_is_help=True, help="The machines that record a study's videos.")

Name = Annotated[str, typer.Option("--name", help="The machine's name in this study.")]


@commands.command("add")
def add(slug: Slug, name: Name, address: Address = "", data_dir: DataDir = None) -> None:
    """Add a machine, and print its token and the command to run there. Both are shown once."""
    app = app_context_of(data_dir)
    token = machines.add(app, slug, name)
    url = address_of(app, "", address or app.settings.public_url or "https://STUDIO")
    parameters = repository.find(app, slug).plan.parameters
    values = " ".join(f"--{one.name} {{{one.name}}}" for one in parameters)
    print(token)
    typer.echo(
        f"{name} may record videos of {slug} with this token, which is shown once. At the"
        f" machine:\n\ncurl -O {url}/machine/pbpo_machine.py\npython pbpo_machine.py --url {url}"
        f" --study {slug} --token {token} -- python run.py {values} --out {{video}}\n",
        err=True,
    )


@commands.command("list")
def list_machines(slug: Slug, data_dir: DataDir = None) -> None:
    """Show the machines of a study: when each was last seen, and whether it was revoked."""
    app = app_context_of(data_dir)
    study = repository.find(app, slug)
    table = Table("name", "state", "last seen", "added")
    for machine in machines.list_machines(app, study.id):
        state = "connected" if machine.is_connected else "away"
        seen = machine.last_seen_at
        table.add_row(
            machine.name,
            "revoked" if machine.revoked_at is not None else state,
            "never" if seen is None else f"{seen:%Y-%m-%d %H:%M:%S} UTC",
            f"{machine.created_at:%Y-%m-%d} UTC",
        )
    out.print(table)
    with app.database.read() as db:
        stopped_at = machines.stopped_since(db, study.id)
    if stopped_at is not None:
        out.print(
            f"All machines of {slug} are stopped since {stopped_at:%Y-%m-%d %H:%M:%S} UTC. To let"
            f" them work again: pbpo machine release {slug}"
        )


@commands.command("stop")
def stop(slug: Slug, data_dir: DataDir = None) -> None:
    """Emergency stop: give no machine of the study any work until it is released."""
    machines.stop(app_context_of(data_dir), slug)
    out.print(
        f"The machines of {slug} are stopped: none gets work, and those that run are told to stop."
        f" To let them work again: pbpo machine release {slug}"
    )


@commands.command("release")
def release(slug: Slug, data_dir: DataDir = None) -> None:
    """End the emergency stop."""
    machines.release(app_context_of(data_dir), slug)
    out.print(f"The machines of {slug} get work again.")


@commands.command("revoke")
def revoke(slug: Slug, name: Name, data_dir: DataDir = None) -> None:
    """End a machine's token at once; others take over what it had claimed."""
    machines.revoke(app_context_of(data_dir), slug, name)
    out.print(f"The token of {name} opens nothing any more.")
