"""`pbpo account`: who may run studies."""

from __future__ import annotations

from datetime import timedelta
from typing import Annotated

import typer
from rich.table import Table

from app.services import account_list, accounts, invitations
from app.services.accounts import Role, Scope
from app.services.audit import COMMAND_LINE

from .asking import Address, DataDir, address_of, out, say_links, studio_of

app = typer.Typer(no_args_is_help=True, help="Who may run studies.")

Email = Annotated[str, typer.Argument(help="The account's e-mail address.", metavar="EMAIL")]


@app.command()
def create(
    email: Email,
    role: Annotated[
        Role | None,
        typer.Option(help="Default: admin for the first account, experimenter for others."),
    ] = None,
    data_dir: DataDir = None,
) -> None:
    """Make an account; asks for the password."""
    studio = studio_of(data_dir)
    password = typer.prompt("Password", hide_input=True, confirmation_prompt=True)
    made = accounts.create(studio, email, password, role)
    sign_in = address_of(studio, "/sign-in")
    out.print(f"{made.email} can sign in at {sign_in} as {made.role.value}.")


@app.command()
def invite(
    email: Email,
    role: Annotated[Role, typer.Option(help="What the account will be for.")] = Role.EXPERIMENTER,
    address: Address = "",
    data_dir: DataDir = None,
) -> None:
    """Make a link with which somebody makes their account, once, and show it this once."""
    studio = studio_of(data_dir)
    path = invitations.invite(studio, email, role, COMMAND_LINE)
    typer.echo(
        f"Send {email} this link. Within {invitations.LASTS.days} days it lets them choose a"
        f" password and sign in as {role.value}, once:",
        err=True,
    )
    say_links(studio, [path], address)


@app.command()
def reset(email: Email, address: Address = "", data_dir: DataDir = None) -> None:
    """Make a link with which somebody chooses another password, once, and show it this once."""
    studio = studio_of(data_dir)
    path = invitations.reset(studio, email, COMMAND_LINE)
    typer.echo(
        f"Send {email} this link. Within {invitations.LASTS.days} days it lets them choose another"
        " password, once:",
        err=True,
    )
    say_links(studio, [path], address)


@app.command("list")
def list_accounts(data_dir: DataDir = None) -> None:
    """List the accounts."""
    table = Table("address", "role", "made", "disabled", box=None)
    for account in account_list.all_accounts(studio_of(data_dir)):
        disabled = "" if account.disabled_at is None else f"{account.disabled_at:%Y-%m-%d}"
        made = f"{account.created_at:%Y-%m-%d}"
        table.add_row(account.email, account.role.value, made, disabled)
    out.print(table)


@app.command()
def disable(email: Email, data_dir: DataDir = None) -> None:
    """Let nobody in with this account any more."""
    account_list.disable(studio_of(data_dir), email, COMMAND_LINE)
    out.print(f"{email} is disabled. To let them in again: pbpo account enable {email}")


@app.command()
def enable(email: Email, data_dir: DataDir = None) -> None:
    """Let the owner of a disabled account in again."""
    account_list.enable(studio_of(data_dir), email, COMMAND_LINE)
    out.print(f"{email} can sign in again.")


@app.command("role")
def change_role(
    email: Email,
    role: Annotated[Role, typer.Argument(help="admin, experimenter or reviewer.")],
    data_dir: DataDir = None,
) -> None:
    """Give an account another role."""
    account_list.change_role(studio_of(data_dir), email, role, COMMAND_LINE)
    out.print(f"{email} is {role.value} now.")


@app.command()
def token(
    email: Email,
    label: Annotated[str, typer.Option(help="A note on what it is for.")] = "command line",
    scope: Annotated[Scope, typer.Option(help="What it may do.")] = Scope.WRITE,
    days: Annotated[int, typer.Option(help="Days it is good for.", min=1, max=365)] = 365,
    data_dir: DataDir = None,
) -> None:
    """Make an API token for an account, and show it this once."""
    studio = studio_of(data_dir)
    who = accounts.find(studio, email)
    out.print(accounts.create_api_token(studio, who, label, scope, timedelta(days=days)))
