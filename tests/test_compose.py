"""docker-compose.yml, the Dockerfile and the Makefile name nothing that the code does not have.

No engine starts them in the tests; this is what can be checked without one.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from ipaddress import ip_address, ip_network
from pathlib import Path
from typing import Any

import pytest
import typer
import yaml

from app.access.rules import ROUTES, Rule
from app.cli import app as command_line
from app.core.settings import ENV_PREFIX, Settings
from app.main import create_app

REPOSITORY = Path(__file__).resolve().parents[1]
DOCKERFILE = REPOSITORY / ".docker" / "Dockerfile"
OURS = ("migrate", "api", "worker")
ON_THE_INTERNET = ("proxy", "backup")


@pytest.fixture(scope="module")
def compose() -> dict[str, Any]:
    document = yaml.safe_load((REPOSITORY / "docker-compose.yml").read_text())
    assert isinstance(document, dict)
    return document


def environment_of(service: dict[str, Any]) -> dict[str, str]:
    environment = service["environment"]
    assert isinstance(environment, dict)
    return environment


def value_when_unset(text: str) -> str:
    """What compose makes of ``${NAME:-default}`` when nobody sets NAME."""
    return re.sub(r"\$\{[A-Z_]+:-([^}]*)\}", r"\1", text)


def check_command(arguments: list[str]) -> None:
    """Fail unless ``versant ARGUMENTS`` names a command and only options that it has."""
    command: Any = typer.main.get_command(command_line)
    for name in arguments:
        if hasattr(command, "commands"):
            assert name in command.commands, f"there is no `versant {name}`"
            command = command.commands[name]
    known = {option for p in command.params for option in (*p.opts, *p.secondary_opts)}
    used = {a.split("=")[0] for a in arguments if a.startswith("-")}
    assert used <= known, f"`versant {arguments[0]}` has no {used - known}"


def test_the_services_are_there(compose: dict[str, Any]) -> None:
    assert set(compose["services"]) == {"db", *OURS, *ON_THE_INTERNET}
    for name, service in compose["services"].items():
        assert service.get("profiles") == (["internet"] if name in ON_THE_INTERNET else None)
    assert compose["services"]["worker"]["deploy"]["replicas"] >= 2


@pytest.mark.parametrize("name", OURS)
def test_every_service_of_ours_runs_a_command_that_exists(name: str, compose: dict[str, Any]) -> None:
    service = compose["services"][name]
    assert service["build"] == {"context": ".", "dockerfile": str(DOCKERFILE.relative_to(REPOSITORY))}
    assert service["command"][0] == name
    check_command(service["command"])


@pytest.mark.parametrize("name", OURS)
def test_every_variable_is_a_setting(
    name: str, compose: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    environment = environment_of(compose["services"][name])
    settings = {f"{ENV_PREFIX}{field.upper()}" for field in Settings.model_fields}
    assert {variable for variable in environment if variable.startswith(ENV_PREFIX)} <= settings
    for variable, value in environment.items():
        monkeypatch.setenv(variable, value_when_unset(value))
    read = Settings()
    assert read.database_url == "postgresql+psycopg://versant:versant@db:5432/versant"
    assert read.max_upload_bytes == Settings.model_fields["max_upload_bytes"].default


def test_variables_that_people_may_set_are_passed_on_under_their_own_name(compose: dict[str, Any]) -> None:
    for name in OURS:
        for variable, value in environment_of(compose["services"][name]).items():
            passed = re.fullmatch(r"\$\{([A-Z_]+):-[^}]*\}", value)
            assert passed is None or passed[1] == variable


def test_the_database_is_the_one_that_the_services_ask_for(compose: dict[str, Any]) -> None:
    database = environment_of(compose["services"]["db"])
    url = environment_of(compose["services"]["api"])["VERSANT_DATABASE_URL"]
    user, password, name = (database[f"POSTGRES_{part}"] for part in ("USER", "PASSWORD", "DB"))
    assert url == f"postgresql://{user}:{password}@db:5432/{name}"
    assert "ports" not in compose["services"]["db"]


def test_the_order_of_starting(compose: dict[str, Any]) -> None:
    services = compose["services"]
    assert services["migrate"]["depends_on"] == {"db": {"condition": "service_healthy"}}
    for name in ("api", "worker"):
        assert services[name]["depends_on"] == {"migrate": {"condition": "service_completed_successfully"}}


def test_the_health_check_asks_a_route_that_exists(compose: dict[str, Any]) -> None:
    api = compose["services"]["api"]
    asked = re.search(r"http://127\.0\.0\.1:(\d+)(/[a-z]+)", " ".join(api["healthcheck"]["test"]))
    assert asked is not None
    assert asked[1] == environment_of(api)["VERSANT_PORT"]
    assert asked[2] in create_app(Settings()).openapi()["paths"]
    assert ROUTES["GET", asked[2]] is Rule.OPEN


def test_nothing_is_seen_without_a_key_and_only_this_machine_reaches_the_api(
    compose: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    api = compose["services"]["api"]
    for variable, value in environment_of(api).items():
        monkeypatch.setenv(variable, value_when_unset(value))
    read = Settings()
    assert (read.access, read.shown_map) == ("keys", "off")
    assert all(port.startswith("127.0.0.1:") for port in api["ports"])


def test_the_proxy_is_the_one_that_the_api_believes(compose: dict[str, Any]) -> None:
    proxy, api = compose["services"]["proxy"], environment_of(compose["services"]["api"])
    address = proxy["networks"]["default"]["ipv4_address"]
    assert value_when_unset(api["VERSANT_TRUSTED_PROXIES"]) == address
    (pool,) = compose["networks"]["default"]["ipam"]["config"]
    assert ip_address(address) in ip_network(pool["subnet"])
    command = proxy["command"]
    assert command[:2] == ["caddy", "reverse-proxy"]
    assert command[command.index("--to") + 1] == f"api:{api['VERSANT_PORT']}"
    assert value_when_unset(command[command.index("--from") + 1]) == "localhost"


def test_the_nightly_backup_is_a_command_that_the_image_can_run(compose: dict[str, Any]) -> None:
    backup = compose["services"]["backup"]
    found = re.search(r"versant (backup (/\w+)/\w+);", backup["entrypoint"][2])
    assert found is not None
    check_command(found[1].split())
    assert f"backups:{found[2]}" in backup["volumes"]
    text = DOCKERFILE.read_text()
    assert "postgresql-client" in text  # pg_dump
    assert re.search(rf"install -d -o versant -g versant .*{found[2]}", text)


def test_the_first_steps_are_commands_that_exist() -> None:
    text = (REPOSITORY / "docker-compose.yml").read_text()
    steps = re.findall(r"^#   docker compose exec api versant (.+?)(?:  .*)?$", text, flags=re.MULTILINE)
    assert [step.split()[:2] for step in steps] == [["keys", "create"], ["keys", "link"]]
    for step in steps:
        check_command(step.split())


def test_volumes_are_declared_and_data_is_shared(compose: dict[str, Any]) -> None:
    used = {mount.split(":")[0] for s in compose["services"].values() for mount in s["volumes"]}
    assert used == set(compose["volumes"])
    for name in OURS:
        data_dir = environment_of(compose["services"][name])["VERSANT_DATA_DIR"]
        assert compose["services"][name]["volumes"] == [f"data:{data_dir}"]


def dockerfile(instruction: str) -> Iterator[str]:
    text = DOCKERFILE.read_text().replace("\\\n", "")
    yield from re.findall(rf"^{instruction} (.*)$", text, flags=re.MULTILINE)


def test_the_dockerfile_copies_what_exists_and_what_is_let_through() -> None:
    let_through = (REPOSITORY / ".dockerignore").read_text().splitlines()
    sources = [source for line in dockerfile("COPY") for source in line.split()[:-1]]
    assert {"app", "fusion", "migrations", ".lock/runtime.txt"} <= set(sources)
    for source in sources:
        assert (REPOSITORY / source).exists(), source
        assert f"!{source}" in let_through


def test_the_dockerfile_runs_versant_unprivileged_with_settings_that_exist() -> None:
    assert list(dockerfile("ENTRYPOINT")) == ['["versant"]']
    check_command(yaml.safe_load(next(dockerfile("CMD"))))
    assert next(dockerfile("USER")) not in {"root", "0"}
    variables = {pair.split("=")[0] for line in dockerfile("ENV") for pair in line.split()}
    ours = {variable for variable in variables if variable.startswith(ENV_PREFIX)}
    assert ours <= {f"{ENV_PREFIX}{field.upper()}" for field in Settings.model_fields}


def test_the_makefile_runs_commands_that_exist() -> None:
    runs = re.findall(r"\$\(BIN\)/versant (.+)", (REPOSITORY / "Makefile").read_text())
    assert runs
    for arguments in runs:
        check_command(arguments.split())
