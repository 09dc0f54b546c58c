"""`pbpo account`: who may run studies."""

from __future__ import annotations

from datetime import timedelta
from typing import Annotated

import typer
from rich.table import Table

from app.services.accounts import accounts, administration, invitations
from app.services.accounts.accounts import Role, Scope
from app.services.accounts.audit_log import COMMAND_LINE

from .options import Address, DataDir, address_of, app_context_of, out, say_links

commands = typer.Typer(no_args_is_help=True, help="Who may run studies.")

Email = Annotated[str, typer.Argument(help="The account's e-mail address.", metavar="EMAIL")]


@commands.command()
def create(
    email: Email,
    role: Annotated[
        Role | None,
        typer.Option(help="Default: admin for the first account, experimenter for others."),
    ] = None,
    data_dir: DataDir = None,
) -> None:
    """Make an account; asks for the password."""
    app = app_context_of(data_dir)
    password = typer.prompt("Password", hide_input=True, confirmation_prompt=True)
    made = accounts.create(app, email, password, role)
    sign_in = address_of(app, "/sign-in")
    out.print(f"{made.email} can sign in at {sign_in} as {made.role.value}.")


@commands.command()
def invite(
    email: Email,
    role: Annotated[Role, typer.Option(help="What the account will be for.")] = Role.EXPERIMENTER,
    address: Address = "",
    data_dir: DataDir = None,
) -> None:
    """Make a link with which somebody makes their account, once, and show it this once."""
    app = app_context_of(data_dir)
    path = invitations.invite(app, email, role, COMMAND_LINE)
    typer.echo(
        f"Send {email} this link. Within {invitations.LASTS.days} days it lets them choose a"
        f" password and sign in as {role.value}, once:",
        err=True,
    )
    say_links(app, [path], address)


@commands.command()
def reset(email: Email, address: Address = "", data_dir: DataDir = None) -> None:
    """Make a link with which somebody chooses another password, once, and show it this once."""
    app = app_context_of(data_dir)
    path = invitations.reset(app, email, COMMAND_LINE)
    typer.echo(
        f"Send {email} this link. Within {invitations.LASTS.days} days it lets them choose another"
        " password, once:",
        err=True,
    )
    say_links(app, [path], address)


@commands.command("list")
def list_accounts(data_dir: DataDir = None) -> None:
    """List the accounts."""
    table = Table("address", "role", "made", "disabled", box=None)
    for account in administration.all_accounts(app_context_of(data_dir)):
        disabled = "" if account.disabled_at is None else f"{account.disabled_at:%Y-%m-%d}"
        made = f"{account.created_at:%Y-%m-%d}"
        table.add_row(account.email, account.role.value, made, disabled)
    out.print(table)


@commands.command()
def disable(email: Email, data_dir: DataDir = None) -> None:
    """Let nobody in with this account any more."""
    administration.disable(app_context_of(data_dir), email, COMMAND_LINE)
    out.print(f"{email} is disabled. To let them in again: pbpo account enable {email}")


@commands.command()
def enable(email: Email, data_dir: DataDir = None) -> None:
    """Let the owner of a disabled account in again."""
    administration.enable(app_context_of(data_dir), email, COMMAND_LINE)
    out.print(f"{email} can sign in again.")


@commands.command("role")
def change_role(
    email: Email,
    role: Annotated[Role, typer.Argument(help="admin, experimenter or reviewer.")],
    data_dir: DataDir = None,
) -> None:
    """Give an account another role."""
    administration.change_role(app_context_of(data_dir), email, role, COMMAND_LINE)
    out.print(f"{email} is {role.value} now.")


@commands.command()
def token(
    email: Email,
    label: Annotated[str, typer.Option(help="A note on what it is for.")] = "command line",
    scope: Annotated[Scope, typer.Option(help="What it may do.")] = Scope.WRITE,
    days: Annotated[int, typer.Option(help="Days it is good for.", min=1, max=365)] = 365,
    data_dir: DataDir = None,
) -> None:
    """Make an API token for an account, and show it this once."""
    app = app_context_of(data_dir)
    who = accounts.find(app, email)
    out.print(accounts.create_api_token(app, who, label, scope, timedelta(days=days)))
