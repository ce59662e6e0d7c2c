# The plugin in QGIS: linked into a profile of this checkout (set-up), or into the user's own (make install).
# shellcheck shell=bash

PRIVATE_PROFILE=$ROOT/.qgis
PLUGIN=slopewatch

enable_plugin() { QT_QPA_PLATFORM=offscreen timeout 120 qgis_process plugins enable "$PLUGIN"; }
is_plugin_enabled() { grep -qs "^$PLUGIN=true" "$1"/QGIS/QGIS*.ini; }

setup_profile() {
    local plugins=$PRIVATE_PROFILE/profiles/default/python/plugins key message
    key=$(step_key "$(qgis_version)" -- "$ROOT/metadata.txt" "$ROOT/scripts/setup/profile.sh")
    if is_stamped profile "$key" && [[ $plugins/$PLUGIN -ef $ROOT ]]; then
        say "profile: .qgis, as before"
        return
    fi
    unstamp profile
    say "profile: linking the plugin into a QGIS profile of this checkout, .qgis (your own profile is not touched)"
    mkdir -p "$plugins"
    ln -sfn "$ROOT" "$plugins/$PLUGIN"
    # qgis_process fails for a plugin that is switched on already, so what counts is what stands in the profile.
    if ! is_plugin_enabled "$PRIVATE_PROFILE/profiles/default"; then
        message=$(QGIS_CUSTOM_CONFIG_PATH=$PRIVATE_PROFILE enable_plugin 2>&1) || true
        is_plugin_enabled "$PRIVATE_PROFILE/profiles/default" || {
            printf '%s\n' "$message" >&2
            die "QGIS could not switch the plugin on (its message is above)"
        }
    fi
    stamp profile "$key"
}

# Folder of the user's QGIS profiles, and the profile that QGIS starts with.
user_profiles() {
    local data=${XDG_DATA_HOME:-$HOME/.local/share}/QGIS
    if version_at_least "$(qgis_version)" 4.0; then printf '%s/QGIS4/profiles\n' "$data"; else printf '%s/QGIS3/profiles\n' "$data"; fi
}
user_profile() {
    local profiles name
    profiles=$(user_profiles)
    name=$(sed -n 's/^defaultProfile=//p' "$profiles/profiles.ini" 2>/dev/null || true)
    printf '%s/%s\n' "$profiles" "${name:-default}"
}

install_plugin() {
    local profile place
    qgis_works || die "QGIS >= $QGIS_OLDEST is not there: run 'make setup' first"
    profile=$(user_profile)
    place=$profile/python/plugins/$PLUGIN
    if [[ -e $place && ! -L $place ]]; then
        die "$place is a copy that QGIS's plugin manager installed: uninstall it there first, so that QGIS does not see two"
    fi
    mkdir -p "$(dirname "$place")"
    ln -sfn "$ROOT" "$place"
    say "linked $place to $ROOT: QGIS uses this checkout, so do not delete it"
    # By name, so that the profile switched on is the one that was linked.
    QGIS_CUSTOM_CONFIG_PATH=$(dirname "$(user_profiles)") enable_plugin >/dev/null 2>&1 || true
    if is_plugin_enabled "$profile"; then
        say "switched on in profile $(basename "$profile"): start QGIS, the algorithms are in the Processing toolbox under SlopeWatch"
    else
        say "start QGIS and switch SlopeWatch on in Plugins > Manage and Install Plugins"
    fi
}

uninstall_plugin() {
    local place
    place=$(user_profile)/python/plugins/$PLUGIN
    if [[ -L $place ]]; then
        rm -f "$place"
        say "removed $place; the checkout and all results stay"
    elif [[ -e $place ]]; then
        die "$place was installed by QGIS's plugin manager: uninstall it there"
    else
        say "nothing to remove: $place is not there"
    fi
}
